// Irradiance environment map [@ramamoorthi2001irradiance]: a table over normals, and the brightest
// texels as distant lamps (environment/irradiance.rs).

// N.L, times what an interface lets in.
fn entering(light: vec3f) -> f32 {
    if (COATED) {
        // A view along the normal sees all that leaves.
        return crossing(light, pixel.normal);
    }
    return max(inner(pixel.normal, light), 0.0);
}

// What falls on the pixel's facet, whose normal has a place in the projection; what an interface
// transmits to the eye is in it.
fn irradiance(place: vec2f) -> vec3f {
    // What overshoots beside an edge may be negative.
    var sum = max(table_at(0u, place), vec3f(0.0));
    for (var texel = 0u; texel < around.bright; texel++) {
        let direction = tables[around.bright_start + 2u * texel].xyz;
        let light = tables[around.bright_start + 2u * texel + 1u].xyz;
        sum = fma(vec3f(entering(direction)), light, sum);
    }
    if (COATED) {
        // Light along the normal enters without loss.
        sum *= crossing(pixel.normal, view_direction());
    }
    return sum;
}
