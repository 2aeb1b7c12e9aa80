// The second term of eq. 1 and 9: interface reflection (specular.rs, surface/lobe.rs).

struct Shape {
    numbers: vec3f,
    // Whether all of them are.
    known: bool,
}

fn shape_of(number: u32) -> Shape {
    let planes = frame.planes[number];
    var shape = frame.numbers[number].yzw;
    if (((SHAPE_MAPS >> (3u * number)) & 1u) != 0u) {
        shape.x = raw(planes.y);
    }
    if (((SHAPE_MAPS >> (3u * number + 1u)) & 1u) != 0u) {
        shape.y = raw(planes.z);
    }
    if (((SHAPE_MAPS >> (3u * number + 2u)) & 1u) != 0u) {
        shape.z = raw(planes.w);
    }
    let known = !(is_nan(shape.x) || is_nan(shape.y) || is_nan(shape.z));
    return Shape(select(vec3f(1.0), shape, vec3(known)), known);
}

// What a lobe of unit strength reflects of a lamp, or of a point of it, which lies in a direction.
fn value_of(lamp: Lamp, light: vec3f, shape: vec3f, spread: f32) -> f32 {
    if (MODEL == 0u) {
        return torrance_sparrow(lamp, light, shape.x, spread);
    }
    return lafortune(lamp, light, shape, spread);
}

// What it reflects of a lamp: of a disc the mean over its points (area.rs).
fn reflected(lamp: Lamp, shape: vec3f) -> f32 {
    if (SIZED_LAMPS) {
        if (lamp.points > 1u) {
            var sum = 0.0;
            for (var number = 0u; number < lamp.points; number++) {
                let point = lamps[lamp.first_point + number];
                sum += value_of(point, light_direction(point), shape, lamp.spread);
            }
            return sum * (1.0 / f32(lamp.points));
        }
    }
    return value_of(lamp, pixel.light, shape, 0.0);
}

fn neutral_strength(number: u32) -> f32 {
    if (((STRENGTH_MAPS >> number) & 1u) != 0u) {
        return raw(frame.planes[number].x);
    }
    return frame.numbers[number].x;
}

// One lobe under the current lamp; a lobe that is not there shows nothing, whatever its shape.
fn lobe(number: u32, lamp: Lamp) {
    let shape = shape_of(number);
    let value = reflected(lamp, shape.numbers) * pixel.reach;
    if (((TINTED >> number) & 1u) != 0u) {
        // Coloured as its strengths are.
        for (var k = 0u; k < COEFFICIENTS; k++) {
            let strength = strength_of(raw(frame.planes[number].x + k), shape.known);
            let column = colours[lamp.colour + k].xyz;
            pixel.sum = fma(vec3f(strength * value), column, pixel.sum);
        }
    } else {
        // The light's colour.
        pixel.specular += strength_of(neutral_strength(number), shape.known) * value;
    }
}

// A strength without which, if it is not 0, the pixel is not known; nor is it without the shape.
fn strength_of(strength: f32, shape_known: bool) -> f32 {
    let finite = is_finite(strength);
    let absent = finite && strength == 0.0;
    pixel.known = pixel.known && finite && (absent || shape_known);
    return select(0.0, strength, finite);
}

// Written out: a loop would keep the constants from being folded.
fn specular(lamp: Lamp) {
    if (LOBES > 0u) {
        lobe(0u, lamp);
    }
    if (LOBES > 1u) {
        lobe(1u, lamp);
    }
    if (LOBES > 2u) {
        lobe(2u, lamp);
    }
    if (LOBES > 3u) {
        lobe(3u, lamp);
    }
    if (LOBES > 4u) {
        lobe(4u, lamp);
    }
    if (LOBES > 5u) {
        lobe(5u, lamp);
    }
    if (LOBES > 6u) {
        lobe(6u, lamp);
    }
    if (LOBES > 7u) {
        lobe(7u, lamp);
    }
}
