// Takes a lamp's light from the pixels that do not see it (visible.rs).

// The number of a pixel from its word, which holds two.
fn share_code(word: u32, number: u32) -> u32 {
    return (word >> (16u * (number & 1u))) & 0xffffu;
}

// The share that it stands for (shadow/shares.rs).
fn share_of(code: u32) -> f32 {
    return f32(code) * (1.0 / 65535.0);
}

fn visible(lamp: Lamp) {
    let number = frame.first + pixel.number;
    if (SIZED_LAMPS) {
        if (lamp.shares != 0u) {
            pixel.reach *= share_of(share_code(visibility[lamp.visibility + number / 2u], number));
            return;
        }
    }
    let word = visibility[lamp.visibility + number / 32u];
    pixel.reach *= f32((word >> (number % 32u)) & 1u);
}
