// Geometry becomes colour: one matrix and one vector per illuminant (colour.rs).

// `first` is the colour's first column.
fn colour(first: u32) {
    var reflected = vec3f(0.0);
    for (var k = 0u; k < COEFFICIENTS; k++) {
        reflected = fma(vec3f(needed(3u + k)), colours[first + k].xyz, reflected);
    }
    pixel.sum = fma(reflected, vec3f(pixel.diffuse), pixel.sum);
    let interface_colour = colours[first + COEFFICIENTS].xyz;
    pixel.sum = fma(vec3f(pixel.specular), interface_colour, pixel.sum);
    pixel.diffuse = 0.0;
    pixel.specular = 0.0;
}
