// Light of an environment: irradiance, then every lobe, then colour (environment/stage.rs).

// Irradiance relative to the open sky, with one bounce (occlusion.rs).
fn one_bounce(visible: f32, albedo: f32) -> f32 {
    return visible * fma(albedo, 1.0 - visible, 1.0);
}

// The share of its light that the relief leaves.
fn left_of_sky() -> f32 {
    let number = frame.first + pixel.number;
    let code = share_code(sky[number / 2u], number);
    // What sees all of the sky loses nothing, however long its normal; what faces away from it has
    // nothing to lose.
    let whole = max(1.0 + pixel.normal.z, 1e-6);
    let share = select(2.0 * share_of(code) / whole, 1.0, code == 65535u);
    return min(share, 1.0);
}

// One lobe; a lobe that is not there shows nothing, whatever its shape.
fn lobe_around(number: u32, place: vec2f, left: f32) {
    let shape = shape_of(number);
    var value: vec3f;
    if (MODEL == 1u) {
        value = lafortune_around(shape.numbers);
    } else if (((SHAPE_MAPS >> (3u * number)) & 1u) != 0u) {
        value = glossy_between(number, place, shape.numbers.x);
    } else {
        value = glossy(number, place);
    }
    if (SKY) {
        value *= left;
    }
    if (((TINTED >> number) & 1u) != 0u) {
        // Coloured as its strengths are.
        for (var k = 0u; k < COEFFICIENTS; k++) {
            let strength = strength_of(raw(frame.planes[number].x + k), shape.known);
            let shown = strength * value;
            pixel.sum = fma(vec3f(shown.x), colours[around.colours.x + k].xyz, pixel.sum);
            pixel.sum = fma(vec3f(shown.y), colours[around.colours.y + k].xyz, pixel.sum);
            pixel.sum = fma(vec3f(shown.z), colours[around.colours.z + k].xyz, pixel.sum);
        }
    } else {
        // The environment's colours.
        pixel.mirrored += strength_of(neutral_strength(number), shape.known) * value;
    }
}

// What a channel's light becomes; `first` is its colour's first column.
fn channel(first: u32, falling: f32, mirrored: f32) {
    pixel.diffuse = falling;
    pixel.specular = mirrored;
    colour(first);
}

fn environment() {
    let place = projected(pixel.normal);
    var left = 1.0;
    if (SKY) {
        left = left_of_sky();
    }
    var falling = irradiance(place);
    if (SKY) {
        falling *= one_bounce(left, around.albedo);
    }
    pixel.mirrored = vec3f(0.0);
    // A loop: beside the tables that a lobe looks up, its constants take no time.
    for (var number = 0u; number < LOBES; number++) {
        lobe_around(number, place, left);
    }
    channel(around.colours.x, falling.x, pixel.mirrored.x);
    channel(around.colours.y, falling.y, pixel.mirrored.y);
    channel(around.colours.z, falling.z, pixel.mirrored.z);
}
