// The display's tone curve as a table over the square root of light, to 8 bits (curve.rs, show.rs).

const CELLS: u32 = 2048u;

fn code(light: f32, channel: u32) -> u32 {
    let place = sqrt(clamp(light, 0.0, 1.0)) * 2048.0;
    let cell = min(floor(place), 2047.0);
    let ends = tone_curve[channel * CELLS + u32(cell)];
    return u32(round(min(fma(ends.y, place - cell, ends.x), 1.0) * 255.0));
}

// Red, green, blue and coverage, from the lowest byte on.
fn codes(light: vec3f, covered: bool) -> u32 {
    let rgb = code(light.x, 0u) | (code(light.y, 1u) << 8u) | (code(light.z, 2u) << 16u);
    return rgb | select(0u, 0xff000000u, covered);
}
