// The second term of eq. 1 and 9: interface reflection (specular.rs, surface/lobe.rs).

// One lobe under the current lamp; a lobe that is not there shows nothing, whatever its shape.
fn lobe(number: u32, lamp: Lamp) {
    let numbers = frame.numbers[number];
    let planes = frame.planes[number];
    var shape = numbers.yzw;
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
    shape = select(vec3f(1.0), shape, vec3(known));
    var value: f32;
    if (MODEL == 0u) {
        value = torrance_sparrow(lamp, shape.x);
    } else {
        value = lafortune(lamp, shape);
    }
    value *= pixel.reach;
    if (((TINTED >> number) & 1u) != 0u) {
        // Coloured as its strengths are.
        for (var k = 0u; k < COEFFICIENTS; k++) {
            let strength = strength_of(raw(planes.x + k), known);
            let column = colours[lamp.colour * (COEFFICIENTS + 1u) + k].xyz;
            pixel.sum = fma(vec3f(strength * value), column, pixel.sum);
        }
    } else {
        // The light's colour.
        var strength = numbers.x;
        if (((STRENGTH_MAPS >> number) & 1u) != 0u) {
            strength = raw(planes.x);
        }
        pixel.specular += strength_of(strength, known) * value;
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
