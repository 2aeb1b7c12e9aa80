// Irradiance of a lamp at normal incidence, before anything stands in its light (diffuse.rs).

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
