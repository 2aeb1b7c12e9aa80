// The lobe of Lafortune et al. [@lafortune1997nonlinear] of unit strength (brdf/lafortune.rs), in
// the domain of logarithms; radiance carries N.L.

fn lafortune(lamp: Lamp, shape: vec3f) -> f32 {
    let view = view_direction();
    var light_view = lamp.light_view;
    if (NEAR_LIGHTS || NEAR_VIEW) {
        light_view = inner(pixel.light, view);
    }
    let n_l = inner(pixel.normal, pixel.light);
    let n_v = inner(pixel.normal, view);
    let upright = n_l * n_v;
    let base = fma(shape.x, light_view - upright, shape.y * upright);
    // exp(-20): below it any lobe is dark.
    let smallest = 2.061153622438558e-9;
    let power = clamp(shape.z * ln_in_range(clamp(base, smallest, 3e38)), -60.0, 40.0);
    // No light from behind, no sight from behind.
    let lit = base > smallest && n_l > 0.0 && n_v > 0.0;
    return select(0.0, n_l * exp_in_range(power), lit);
}
