// The first term of eq. 1 and 9: (N.L) S(lambda) E(lambda), without its colour (diffuse.rs); under
// a smooth interface by Wolff's model [@wolff1994diffuse] (brdf/coated_diffuse.rs).

// What the interface transmits at a cosine of incidence, relative to normal incidence.
fn transmission(cosine: f32) -> f32 {
    let index = frame.coat.x;
    let inverse = frame.coat.y;
    // Grazing: quotients stay finite.
    let c = max(cosine, 1e-4);
    let q = max(sqrt(fma(index, index, fma(c, c, -1.0))), c);
    let a = 1.0 / (q + c);
    let b = 1.0 / fma(index, c, q * inverse);
    return frame.coat_scale * (q * c) * fma(a, a, b * b);
}

// N.L times what the interface lets in and out.
fn crossing(light: vec3f, view: vec3f) -> f32 {
    let n_l = inner(pixel.normal, light);
    let n_v = inner(pixel.normal, view);
    let value = n_l * transmission(n_l) * transmission(n_v);
    return select(0.0, value, n_l > 0.0 && n_v > 0.0);
}

fn diffuse() {
    var cosine = max(inner(pixel.normal, pixel.light), 0.0);
    if (COATED) {
        cosine = crossing(pixel.light, view_direction());
    }
    pixel.diffuse = fma(cosine, pixel.reach, pixel.diffuse);
}
