// Torrance-Sparrow lobes in an environment: tables over the normal for one view
// (environment/torrance_sparrow.rs).

// The widest gamma of a table; each next one is a quarter octave narrower.
const WIDEST: f32 = 1.25;
const GAMMA_MIN: f32 = 5e-4;

// One gamma for the whole painting: one table. `number` is that of the lobe.
fn glossy(number: u32, place: vec2f) -> vec3f {
    let widths = around.widths[number];
    return max(table_at(widths.first, place), vec3f(0.0)) * widths.factor;
}

// A gamma of the pixel's own: a cubic in log gamma of Y / gamma.
fn glossy_between(number: u32, place: vec2f, gamma: f32) -> vec3f {
    let widths = around.widths[number];
    let given = max(gamma, GAMMA_MIN);
    let below = min(given / widths.narrowest, 1.0);
    let kept = clamp(given, widths.narrowest, WIDEST);
    let level = ln_in_range(WIDEST / kept) * 5.770780163555854;
    let first = clamp(u32(level), 1u, widths.count - 3u) - 1u;
    let weights = lagrange(level - f32(first + 1u));
    let table = widths.first + first;
    var sum = table_at(table, place) * weights.x;
    sum = fma(table_at(table + 1u, place), vec3f(weights.y), sum);
    sum = fma(table_at(table + 2u, place), vec3f(weights.z), sum);
    sum = fma(table_at(table + 3u, place), vec3f(weights.w), sum);
    return max(sum, vec3f(0.0)) * (kept * (below * below));
}
