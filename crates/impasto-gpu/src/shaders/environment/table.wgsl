// Tables over directions: Lambert's azimuthal equal-area projection [@snyder1987map], read by cubic
// convolution [@keys1981cubic] (environment/table.rs). No sampler: its weights have 8 bits.

// Place of a unit vector in the projection.
fn projected(direction: vec3f) -> vec2f {
    let above = direction.z + 1.0;
    if (above < 1e-6) {
        // All of the rim is the direction away from the eye.
        return vec2f(1.0, 0.0);
    }
    return direction.xy * (1.0 / sqrt(above + above));
}

struct Cell {
    // The node left of a place, or above it ...
    first: u32,
    // ... and how far the place lies beyond it.
    beyond: f32,
}

fn cell(nodes: Layout, place: f32) -> Cell {
    let at = clamp(fma(place, nodes.scale, nodes.middle), 1.0, f32(nodes.size - 2u));
    let first = min(u32(at), nodes.size - 3u);
    return Cell(first, at - f32(first));
}

// Weights of four neighbours for a place between the second and the third.
fn cubic(f: f32) -> vec4f {
    return vec4f(
        fma(fma(-0.5, f, 1.0), f, -0.5) * f,
        fma(fma(1.5, f, -2.5), f * f, 1.0),
        fma(fma(-1.5, f, 2.0), f, 0.5) * f,
        fma(0.5, f, -0.5) * (f * f),
    );
}

// Weights of four equally spaced neighbours for any place, the first at -1: Lagrange's cubic.
fn lagrange(f: f32) -> vec4f {
    let before = f + 1.0;
    let after = f - 1.0;
    let last = f - 2.0;
    return vec4f(
        f * after * last * (-1.0 / 6.0),
        before * after * last * 0.5,
        before * f * last * -0.5,
        before * f * after * (1.0 / 6.0),
    );
}

// Four nodes below each other.
fn down(first: u32, size: u32, along: vec4f) -> vec3f {
    var sum = tables[first].xyz * along.x;
    sum = fma(tables[first + size].xyz, vec3f(along.y), sum);
    sum = fma(tables[first + 2u * size].xyz, vec3f(along.z), sum);
    return fma(tables[first + 3u * size].xyz, vec3f(along.w), sum);
}

// A table of one number per channel at a place of the projection.
fn table_at(number: u32, place: vec2f) -> vec3f {
    let nodes = around.layouts[number];
    let column = cell(nodes, place.x);
    let row = cell(nodes, place.y);
    let across = cubic(column.beyond);
    let along = cubic(row.beyond);
    let first = nodes.start + (row.first - 1u) * nodes.size + column.first - 1u;
    var sum = down(first, nodes.size, along) * across.x;
    sum = fma(down(first + 1u, nodes.size, along), vec3f(across.y), sum);
    sum = fma(down(first + 2u, nodes.size, along), vec3f(across.z), sum);
    return fma(down(first + 3u, nodes.size, along), vec3f(across.w), sum);
}
