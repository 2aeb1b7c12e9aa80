// What every stage reads, and the one pixel that goes through all of them.
//
// The constants below say what a scene calls for; a pipeline is compiled per choice, so that an
// effect that is off costs nothing.

// Of the lobes: 0 Torrance-Sparrow, 1 Lafortune.
override MODEL: u32 = 0u;
override LOBES: u32 = 0u;
// One bit per lobe: its strength is a map; its strength is one map per coefficient.
override STRENGTH_MAPS: u32 = 0u;
override TINTED: u32 = 0u;
// Three bits per lobe: this number of its shape is a map.
override SHAPE_MAPS: u32 = 0u;
override COEFFICIENTS: u32 = 1u;
// Drivers that compute on the CPU are a fifth slower with a loop.
override ONE_LAMP: bool = false;
override NEAR_LIGHTS: bool = false;
override NEAR_VIEW: bool = false;
override COATED: bool = false;
override AMBIENT: bool = false;
override SHADOWS: bool = false;
// Whether any lamp is a disc.
override SIZED_LAMPS: bool = false;
// The relief hides a part of the environment.
override SKY: bool = false;
// Lafortune lobes in an environment by the scheme of scalars.
override SCALAR: bool = false;
// Display codes; otherwise light.
override CODES: bool = false;

const WORKGROUP: u32 = 64u;
const MAX_LOBES: u32 = 8u;
const MAX_LAYOUTS: u32 = 256u;

struct Frame {
    // Unit direction to the eye, or its place in mm.
    view: vec3f,
    // Width of a pixel in mm.
    pitch: f32,
    // What is shown where nothing is known.
    background: vec3f,
    // Index of refraction of the lobes' interface.
    index: f32,
    // Column and row of the first pixel of this band from the painting's middle, in pixels.
    corner: vec2f,
    // Of the interface above the diffuse part: index of refraction, its reciprocal ...
    coat: vec2f,
    // ... and 2 / (1 - F(1)).
    coat_scale: f32,
    // Pixels of this band, its columns, the number of its first pixel in the painting.
    pixels: u32,
    width: u32,
    first: u32,
    lamps: u32,
    // The first map of ambient light.
    ambient: u32,
    unused_a: u32,
    unused_b: u32,
    // Strength and shape of each lobe: numbers, or which map.
    numbers: array<vec4f, MAX_LOBES>,
    planes: array<vec4u, MAX_LOBES>,
}

struct Lamp {
    // Unit direction to the lamp, or its place in mm.
    towards: vec3f,
    intensity: f32,
    // Of a distant lamp and a distant eye: what the lobes' model needs of both.
    halfway: vec3f,
    twice_over_v_h: f32,
    fresnel: f32,
    light_view: f32,
    // Of a near lamp with fall-off, its distance from the painting's middle; else 0.
    distance: f32,
    near: u32,
    // The first column of its colour.
    colour: u32,
    // 1 for the last lamp of its colour.
    last: u32,
    // The first word of its visibility, and whether that is a share of the lamp: 1, else 0.
    visibility: u32,
    shares: u32,
    // What lobes see of it: how many points, and the first of them among the lamps ...
    points: u32,
    first_point: u32,
    // ... and the variance of directions about each, in radians squared.
    spread: f32,
    unused: u32,
}

// Where the nodes of a table are: (y, x) of one or four vectors each, from `start` on.
struct Layout {
    start: u32,
    // Nodes of a side.
    size: u32,
    // From the projection to places among the nodes.
    scale: f32,
    middle: f32,
}

// The tables of a Torrance-Sparrow lobe.
struct Widths {
    first: u32,
    count: u32,
    factor: f32,
    narrowest: f32,
}

// An environment.
struct Around {
    // The first column of the colour of each channel.
    colours: vec3u,
    // Mean reflectance of the relief, for one bounce.
    albedo: f32,
    // Texels that are lamps of their own: how many, and where direction and light of the first are.
    bright: u32,
    bright_start: u32,
    unused_a: u32,
    unused_b: u32,
    widths: array<Widths, MAX_LOBES>,
    // That of the irradiance, then those of the lobes.
    layouts: array<Layout, MAX_LAYOUTS>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> lamps: array<Lamp>;
// Per colour: a column per coefficient, and the colour of the light itself.
@group(0) @binding(2) var<storage, read> colours: array<vec4f>;
// Planes of this band: normal, diffuse, ambient, and those of the lobes.
@group(0) @binding(3) var<storage, read> maps: array<f32>;
// Lamp by lamp one bit per pixel of the painting, or a share of 16 bits.
@group(0) @binding(4) var<storage, read> visibility: array<u32>;
// Per channel: the value at the left end of each cell, and what it rises by.
@group(0) @binding(5) var<storage, read> tone_curve: array<vec2f>;
// All tables of an environment: red, green and blue.
@group(0) @binding(6) var<storage, read> tables: array<vec4f>;
// The share of the sky that each pixel sees, 16 bits each.
@group(0) @binding(7) var<storage, read> sky: array<u32>;
// Light and coverage as planes, or a word of four codes per pixel.
@group(0) @binding(8) var<storage, read_write> shown: array<u32>;
@group(0) @binding(9) var<uniform> around: Around;

struct Pixel {
    // In this band.
    number: u32,
    // False once something that the pixel needs is no number. Shaders may assume that there is no
    // NaN, so none is computed with: it is found by its bits and kept here.
    known: bool,
    normal: vec3f,
    // On the painting, mm.
    place: vec3f,
    // Irradiance of the current lamp at normal incidence.
    reach: f32,
    // Direction to the current lamp.
    light: vec3f,
    // Geometry of the lamps of one colour: the sums of (N.L) E and of beta D F G / (N.V) E.
    diffuse: f32,
    specular: f32,
    // Interface reflection of the three channels of an environment.
    mirrored: vec3f,
    // Light of all colours.
    sum: vec3f,
}

var<private> pixel: Pixel;

fn is_finite(value: f32) -> bool {
    return (bitcast<u32>(value) & 0x7f800000u) != 0x7f800000u;
}

fn is_nan(value: f32) -> bool {
    return (bitcast<u32>(value) & 0x7fffffffu) > 0x7f800000u;
}

// A map's value as it is.
fn raw(plane: u32) -> f32 {
    return maps[plane * frame.pixels + pixel.number];
}

// A map's value without which the pixel is not known.
fn needed(plane: u32) -> f32 {
    let value = raw(plane);
    let finite = is_finite(value);
    pixel.known = pixel.known && finite;
    return select(0.0, value, finite);
}

// x fastest, product-sums with one rounding, as the CPU does it.
fn inner(a: vec3f, b: vec3f) -> f32 {
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

// Unit direction from the pixel to a place, and the reciprocal of its distance.
fn direction_to(place: vec3f) -> vec4f {
    let way = place - pixel.place;
    let inverse = 1.0 / sqrt(inner(way, way));
    return vec4f(way * inverse, inverse);
}

// Direction to the eye.
fn view_direction() -> vec3f {
    if (NEAR_VIEW) {
        return direction_to(frame.view).xyz;
    }
    return frame.view;
}
