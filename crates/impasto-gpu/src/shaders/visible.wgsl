// Takes a lamp's light from the pixels that do not see it (visible.rs).

fn visible(lamp: u32) {
    let number = frame.first + pixel.number;
    let word = visibility[lamp * frame.words + number / 32u];
    pixel.reach *= f32((word >> (number % 32u)) & 1u);
}
