// Cast shadows of a distant light by a running maximum along sheared lines: the sweep of
// relight/shadow/distant.rs, one invocation per line.

const WORKGROUP: u32 = 64u;
// Far below any painting: what throws no shadow.
const ABYSS: f32 = -1e30;

struct Sweep {
    // Pixels across the walk, and rows (or columns) that are walked.
    width: i32,
    steps: u32,
    first_line: i32,
    lines: u32,
    // From pixel to pixel of the relief, across and along the walk.
    across: u32,
    along: u32,
    // Fall of the ray per step.
    fall: f32,
    // 1 if the walk goes towards smaller numbers, 2 more if it goes along rows of the picture.
    walk: u32,
    // Columns and pixels of the picture.
    columns: u32,
    pixels: u32,
    // Words of one lamp, and the first of this one.
    words: u32,
    first_word: u32,
}

// Columns by which lines are displaced after so many steps.
struct Displacement {
    whole: i32,
    fraction: f32,
}

@group(0) @binding(0) var<uniform> light: Sweep;
@group(0) @binding(1) var<storage, read> relief: array<f32>;
@group(0) @binding(2) var<storage, read> displacements: array<Displacement>;
// Below the shadow's surface, (step, line).
@group(0) @binding(3) var<storage, read_write> depths: array<f32>;
@group(0) @binding(4) var<storage, read_write> visibility: array<u32>;

fn is_nan(value: f32) -> bool {
    return (bitcast<u32>(value) & 0x7fffffffu) > 0x7f800000u;
}

// The relief at a place across the walk: the border's height one pixel beyond it, the abyss after.
fn relief_at(row: u32, place: i32) -> f32 {
    let inside = u32(clamp(place, 0, light.width - 1));
    let height = relief[row * light.along + inside * light.across];
    return select(height, ABYSS, place < -1 || place > light.width);
}

fn row_at(step: u32) -> u32 {
    return select(step, light.steps - 1u - step, (light.walk & 1u) != 0u);
}

@compute @workgroup_size(WORKGROUP)
fn sweep(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let line = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (line >= light.lines) {
        return;
    }
    var surface = ABYSS;
    for (var step = 0u; step < light.steps; step++) {
        let displaced = displacements[step];
        let row = row_at(step);
        let place = light.first_line + i32(line) + displaced.whole;
        let left = relief_at(row, place);
        var height = left;
        var unknown = is_nan(left);
        if (displaced.fraction > 0.0) {
            let right = relief_at(row, place + 1);
            unknown = unknown || is_nan(right);
            height = fma(right, displaced.fraction, left * (1.0 - displaced.fraction));
        }
        surface = surface - light.fall;
        // Where the height is unknown nothing is in shadow, and nothing throws one.
        depths[step * light.lines + line] = select(surface - height, 0.0, unknown);
        surface = select(max(height, surface), surface, unknown);
    }
}

// One invocation per word of 32 pixels of the picture.
@compute @workgroup_size(WORKGROUP)
fn lit(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let word = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (word >= light.words) {
        return;
    }
    var bits = 0u;
    for (var bit = 0u; bit < 32u; bit++) {
        let pixel = word * 32u + bit;
        if (pixel < light.pixels) {
            let row = pixel / light.columns;
            let column = pixel - row * light.columns;
            // Along the walk, and across it.
            let along = select(row, column, (light.walk & 2u) != 0u);
            let across = select(column, row, (light.walk & 2u) != 0u);
            let step = row_at(along);
            let displaced = displacements[step];
            // The line left of the pixel, and the one right of it.
            let left = u32(i32(across) - displaced.whole - 1 - light.first_line);
            let before = depths[step * light.lines + left];
            let after = depths[step * light.lines + left + 1u];
            let depth = fma(displaced.fraction, before, (1.0 - displaced.fraction) * after);
            bits |= select(1u, 0u, depth > 0.0) << bit;
        }
    }
    visibility[light.first_word + word] = bits;
}
