// One pixel through all stages (relight/stages.rs).

// What a lamp adds; the last of a colour gives the sums their colour.
fn light_by(index: u32) {
    let lamp = lamps[index];
    reach(lamp);
    if (SHADOWS) {
        visible(lamp);
    }
    diffuse();
    specular(lamp);
    if (AMBIENT) {
        ambient(lamp);
    }
    if (ONE_LAMP || lamp.last != 0u) {
        colour(lamp.colour);
    }
}

@compute @workgroup_size(WORKGROUP)
fn render(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let number = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (number >= frame.pixels) {
        return;
    }
    pixel.number = number;
    pixel.known = true;
    pixel.normal = vec3f(needed(0u), needed(1u), needed(2u));
    if (NEAR_LIGHTS || NEAR_VIEW) {
        // Rows run down, y runs up.
        let row = number / frame.width;
        let at = vec2f(f32(number - row * frame.width), -f32(row)) + frame.corner;
        pixel.place = vec3f(at * frame.pitch, 0.0);
    }
    pixel.diffuse = 0.0;
    pixel.specular = 0.0;
    pixel.sum = vec3f(0.0);
    if (ONE_LAMP) {
        light_by(0u);
    } else {
        for (var index = 0u; index < frame.lamps; index++) {
            light_by(index);
        }
    }
    environment();
    let finite = is_finite(pixel.sum.x) && is_finite(pixel.sum.y) && is_finite(pixel.sum.z);
    let known = pixel.known && finite;
    let light = select(frame.background, pixel.sum, vec3(known));
    if (CODES) {
        shown[number] = codes(light, known);
    } else {
        shown[number] = bitcast<u32>(light.x);
        shown[frame.pixels + number] = bitcast<u32>(light.y);
        shown[2u * frame.pixels + number] = bitcast<u32>(light.z);
        shown[3u * frame.pixels + number] = bitcast<u32>(select(0.0, 1.0, known));
    }
}
