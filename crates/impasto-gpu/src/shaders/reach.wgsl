// Irradiance of a lamp at normal incidence, before anything stands in its light (diffuse.rs).

// Direction to a lamp or one of its points.
fn light_direction(lamp: Lamp) -> vec3f {
    if (NEAR_LIGHTS) {
        if (lamp.near != 0u) {
            return direction_to(lamp.towards).xyz;
        }
    }
    return lamp.towards;
}

fn reach(lamp: Lamp) {
    pixel.light = lamp.towards;
    pixel.reach = lamp.intensity;
    if (NEAR_LIGHTS) {
        if (lamp.near != 0u) {
            let towards = direction_to(lamp.towards);
            pixel.light = towards.xyz;
            if (lamp.distance > 0.0) {
                let ratio = lamp.distance * towards.w;
                pixel.reach = ratio * ratio * lamp.intensity;
            }
        }
    }
}
