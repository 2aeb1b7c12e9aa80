// The lobe of Lafortune et al. [@lafortune1997nonlinear] of unit strength (brdf/lafortune.rs), in
// the domain of logarithms; radiance carries N.L.

// With a spread of light, a variance in radians squared, the lobe is as much wider and keeps its total.
fn lafortune(lamp: Lamp, light: vec3f, shape: vec3f, spread: f32) -> f32 {
    let view = view_direction();
    var light_view = lamp.light_view;
    if (NEAR_LIGHTS || NEAR_VIEW) {
        light_view = inner(light, view);
    }
    let n_l = inner(pixel.normal, light);
    let n_v = inner(pixel.normal, view);
    let upright = n_l * n_v;
    let base = fma(shape.x, light_view - upright, shape.y * upright);
    // exp(-20): below it any lobe is dark.
    let smallest = 2.061153622438558e-9;
    let log_base = ln_in_range(clamp(base, smallest, 3e38));
    var log = shape.z * log_base;
    var share = 1.0;
    if (SIZED_LAMPS) {
        let sharp = min(shape.z, 1e30);
        let exponent = sharp / fma(sharp, spread, 1.0);
        let flat = shape.x * shape.x;
        let square = fma(fma(shape.y, shape.y, -flat), n_v * n_v, flat);
        let length = 0.5 * ln_in_range(clamp(square, smallest, 3e38));
        log = fma(sharp - exponent, length, exponent * log_base);
        share = (exponent + 1.0) / (sharp + 1.0);
    }
    let power = clamp(log, -60.0, 40.0);
    // No light from behind, no sight from behind.
    let lit = base > smallest && n_l > 0.0 && n_v > 0.0;
    return select(0.0, n_l * share * exp_in_range(power), lit);
}
