// The lobe of Torrance and Sparrow [@torrance1967theory] of unit strength (brdf/torrance_sparrow.rs).

// Unpolarised Fresnel reflectance of a dielectric at the cosine of incidence c.
fn fresnel(c: f32, index: f32) -> f32 {
    let q = sqrt(fma(index, index, fma(c, c, -1.0)));
    let sum = q + c;
    let difference = q - c;
    let perpendicular = difference / sum;
    let parallel = fma(c, sum, -1.0) / fma(c, difference, 1.0);
    return 0.5 * perpendicular * perpendicular * fma(parallel, parallel, 1.0);
}

// D F G / (N.V) for the half-width gamma; with a spread of light, a variance in radians squared, D is as
// much wider and keeps its total.
fn torrance_sparrow(lamp: Lamp, light: vec3f, gamma: f32, spread: f32) -> f32 {
    var halfway = lamp.halfway;
    var twice_over_v_h = lamp.twice_over_v_h;
    var reflectance = lamp.fresnel;
    let view = view_direction();
    if (NEAR_LIGHTS || NEAR_VIEW) {
        if (NEAR_VIEW || lamp.near != 0u) {
            let sum = light + view;
            let squared = inner(sum, sum);
            // L = -V: there is no half vector, and nothing is mirrored.
            let opposed = squared < 1e-6;
            let extent = sqrt(select(squared, 1.0, opposed));
            let v_h = min(extent * 0.5, 1.0);
            halfway = sum * (1.0 / extent);
            twice_over_v_h = 2.0 / v_h;
            reflectance = select(fresnel(v_h, frame.index), 0.0, opposed);
        }
    }
    let n_l = inner(pixel.normal, light);
    let n_v = inner(pixel.normal, view);
    let n_h = inner(pixel.normal, halfway);
    // Grazing: the smallest of the three quotients is finite even where N.V is 0.
    let open = 1.0 / max(n_v, 1e-30);
    let masked = twice_over_v_h * n_h;
    let attenuation = min(min(masked, open), masked * n_l * open);
    // The chord, not the arc cosine.
    let chord = pixel.normal - halfway;
    let width = clamp(gamma, 5e-4, 1.25);
    var sharpness = 0.6931471805599453 / (width * width);
    var share = 1.0;
    if (SIZED_LAMPS) {
        // The half vector moves by half of what the light does.
        share = 1.0 / fma(sharpness * 0.5, spread, 1.0);
        sharpness *= share;
    }
    let lobe = exponential(-(sharpness * phi_squared(inner(chord, chord) * 0.5)));
    // No light from behind, no sight from behind.
    return select(0.0, share * reflectance * attenuation * lobe, n_l > 0.0 && n_v > 0.0);
}
