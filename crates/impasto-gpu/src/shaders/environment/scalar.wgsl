// The third paper's scheme [@snel], for comparison: the cosine of incidence in the middle of the lobe
// (environment/scalar.rs).

// (N.p^) G_n(p^).
fn scalar(prefiltered: vec3f, lobe: vec3f) -> vec3f {
    return max(inner(pixel.normal, lobe), 0.0) * prefiltered;
}
