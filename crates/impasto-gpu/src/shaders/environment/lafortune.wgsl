// Prefiltered environment maps for Lafortune lobes, of vectors, which makes the filter exact
// (environment/lafortune.rs, the lobe of stage.rs).

// Of the exponents 2^(-1) .. 2^(10.5), two per octave.
const LEVELS: u32 = 24u;
// Squared length of p below which a lobe is dark.
const SHORT: f32 = 1e-17;

// Sixteen nodes about a place of one table.
struct Near {
    first: u32,
    // Numbers of four of a row.
    row: u32,
    across: vec4f,
    along: vec4f,
}

fn near(number: u32, place: vec2f, weight: f32) -> Near {
    let nodes = around.layouts[number];
    let column = cell(nodes, place.x);
    let row = cell(nodes, place.y);
    let node = (row.first - 1u) * nodes.size + column.first - 1u;
    return Near(
        nodes.start + 4u * node,
        4u * nodes.size,
        cubic(column.beyond),
        cubic(row.beyond) * weight,
    );
}

// Adds a part (x, y and z of the vector, the scalar) of a row of nodes.
fn add_row(nodes: Near, row: u32, along: f32, part: u32, sum: vec3f) -> vec3f {
    let first = nodes.first + row * nodes.row + part;
    let weights = nodes.across * along;
    var total = fma(tables[first].xyz, vec3f(weights.x), sum);
    total = fma(tables[first + 4u].xyz, vec3f(weights.y), total);
    total = fma(tables[first + 8u].xyz, vec3f(weights.z), total);
    return fma(tables[first + 12u].xyz, vec3f(weights.w), total);
}

fn part_of(a: Near, b: Near, c: Near, d: Near, part: u32) -> vec3f {
    var sums: mat4x3f;
    sums[0] = add_row(a, 0u, a.along.x, part, vec3f(0.0));
    sums[1] = add_row(a, 1u, a.along.y, part, vec3f(0.0));
    sums[2] = add_row(a, 2u, a.along.z, part, vec3f(0.0));
    sums[3] = add_row(a, 3u, a.along.w, part, vec3f(0.0));
    sums[0] = add_row(b, 0u, b.along.x, part, sums[0]);
    sums[1] = add_row(b, 1u, b.along.y, part, sums[1]);
    sums[2] = add_row(b, 2u, b.along.z, part, sums[2]);
    sums[3] = add_row(b, 3u, b.along.w, part, sums[3]);
    sums[0] = add_row(c, 0u, c.along.x, part, sums[0]);
    sums[1] = add_row(c, 1u, c.along.y, part, sums[1]);
    sums[2] = add_row(c, 2u, c.along.z, part, sums[2]);
    sums[3] = add_row(c, 3u, c.along.w, part, sums[3]);
    sums[0] = add_row(d, 0u, d.along.x, part, sums[0]);
    sums[1] = add_row(d, 1u, d.along.y, part, sums[1]);
    sums[2] = add_row(d, 2u, d.along.z, part, sums[2]);
    sums[3] = add_row(d, 3u, d.along.w, part, sums[3]);
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

// Where an exponent lies among those of the maps: in half octaves from the first one on.
fn level_of(exponent: f32) -> f32 {
    // 2^(-1) and 2^(10.5).
    let log = ln_in_range(clamp(exponent, 0.5, 1448.1546878700494));
    return clamp(fma(log, 2.8853900817779268, 2.0), 0.0, f32(LEVELS - 1u));
}

// What a lobe of unit strength reflects.
fn lafortune_around(shape: vec3f) -> vec3f {
    let view = view_direction();
    let cosine = inner(pixel.normal, view);
    let p = fma(view, vec3f(shape.x), pixel.normal * ((shape.y - shape.x) * cosine));
    // |p|^2 without the rounding of its components: exactly 1 for a mirror.
    let flat = shape.x * shape.x;
    let square = fma(fma(shape.y, shape.y, -flat), cosine * cosine, flat);
    // No highlight is seen from behind.
    if (!(cosine > 0.0 && square > SHORT)) {
        return vec3f(0.0);
    }
    let exponent = min(shape.z, 1e30);
    let log = exponent * 0.5 * ln_in_range(clamp(square, SHORT, 3e38));
    let factor = exp_in_range(clamp(log, -60.0, 40.0)) / (exponent + 2.0);
    let direction = p * (1.0 / sqrt(max(inner(p, p), SHORT)));
    let place = projected(direction);
    let level = level_of(exponent);
    let first = clamp(u32(level), 1u, LEVELS - 3u) - 1u;
    let weights = lagrange(level - f32(first + 1u));
    // The first table is that of the irradiance.
    let a = near(first + 1u, place, weights.x);
    let b = near(first + 2u, place, weights.y);
    let c = near(first + 3u, place, weights.z);
    let d = near(first + 4u, place, weights.w);
    var light: vec3f;
    if (SCALAR) {
        light = scalar(part_of(a, b, c, d, 3u), direction);
    } else {
        // N . V_n(p^): the cosine inside the integral.
        light = part_of(a, b, c, d, 2u) * pixel.normal.z;
        light = fma(vec3f(pixel.normal.y), part_of(a, b, c, d, 1u), light);
        light = fma(vec3f(pixel.normal.x), part_of(a, b, c, d, 0u), light);
    }
    return max(light, vec3f(0.0)) * factor;
}
