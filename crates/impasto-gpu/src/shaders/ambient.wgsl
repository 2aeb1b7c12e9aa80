// What the surface shows whatever a lamp's direction (colour.rs).

fn ambient(lamp: Lamp) {
    for (var k = 0u; k < COEFFICIENTS; k++) {
        let value = needed(frame.ambient + k) * lamp.intensity;
        let column = colours[lamp.colour + k].xyz;
        pixel.sum = fma(vec3f(value), column, pixel.sum);
    }
}
