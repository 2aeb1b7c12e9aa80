//! What the kernels read, as `shaders/frame.wgsl` and `shaders/shadow.wgsl` declare it.

use bytemuck::{Pod, Zeroable};

/// Most lobes of a pixel that a kernel has room for.
pub(crate) const MAX_LOBES: usize = 8;

/// Most tables of an environment: one of the irradiance, and, of each of eight lobes, thirty between
/// the widest gamma, 1.25, and that of the largest table, 0.008, at every quarter octave.
pub(crate) const MAX_LAYOUTS: usize = 256;

/// `Frame` of the shaders: a picture's circumstances, and those of one band of it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Frame {
    pub(crate) view: [f32; 3],
    pub(crate) pitch: f32,
    pub(crate) background: [f32; 3],
    pub(crate) index: f32,
    pub(crate) corner: [f32; 2],
    pub(crate) coat: [f32; 2],
    pub(crate) coat_scale: f32,
    pub(crate) pixels: u32,
    pub(crate) width: u32,
    pub(crate) first: u32,
    pub(crate) lamps: u32,
    pub(crate) ambient: u32,
    pub(crate) unused: [u32; 2],
    pub(crate) numbers: [[f32; 4]; MAX_LOBES],
    pub(crate) planes: [[u32; 4]; MAX_LOBES],
}

/// `Lamp` of the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Lamp {
    pub(crate) towards: [f32; 3],
    pub(crate) intensity: f32,
    pub(crate) halfway: [f32; 3],
    pub(crate) twice_over_v_h: f32,
    pub(crate) fresnel: f32,
    pub(crate) light_view: f32,
    pub(crate) distance: f32,
    pub(crate) near: u32,
    pub(crate) colour: u32,
    pub(crate) last: u32,
    pub(crate) visibility: u32,
    pub(crate) shares: u32,
    pub(crate) points: u32,
    pub(crate) first_point: u32,
    pub(crate) spread: f32,
    pub(crate) unused: u32,
}

/// `Layout` of the shaders: the nodes of a table.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Layout {
    pub(crate) start: u32,
    pub(crate) size: u32,
    pub(crate) scale: f32,
    pub(crate) middle: f32,
}

/// `Widths` of the shaders: the tables of a Torrance-Sparrow lobe.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Widths {
    pub(crate) first: u32,
    pub(crate) count: u32,
    pub(crate) factor: f32,
    pub(crate) narrowest: f32,
}

/// `Around` of the shaders: an environment.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Around {
    pub(crate) colours: [u32; 3],
    pub(crate) albedo: f32,
    pub(crate) bright: u32,
    pub(crate) bright_start: u32,
    pub(crate) unused: [u32; 2],
    pub(crate) widths: [Widths; MAX_LOBES],
    pub(crate) layouts: [Layout; MAX_LAYOUTS],
}

/// `Sweep` of the shaders: one distant light over the relief.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Sweep {
    pub(crate) width: i32,
    pub(crate) steps: u32,
    pub(crate) first_line: i32,
    pub(crate) lines: u32,
    pub(crate) across: u32,
    pub(crate) along: u32,
    pub(crate) fall: f32,
    pub(crate) walk: u32,
    pub(crate) columns: u32,
    pub(crate) pixels: u32,
    pub(crate) words: u32,
    pub(crate) first_word: u32,
}

/// `Displacement` of the shaders: columns by which lines are displaced after so many rows.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Displacement {
    pub(crate) whole: i32,
    pub(crate) fraction: f32,
}

/// Pixels of a workgroup (`WORKGROUP` of the shaders).
const WORKGROUP: u32 = 64;

/// Most workgroups along one axis, on any device.
const MOST_GROUPS: u32 = 65_535;

/// Workgroups along x and y for so many invocations.
pub(crate) fn workgroups(invocations: u32) -> [u32; 2] {
    let groups = invocations.div_ceil(WORKGROUP).max(1);
    let x = groups.min(MOST_GROUPS);
    [x, groups.div_ceil(x)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workgroups_cover_every_invocation() {
        for invocations in [0, 1, 64, 65, 1 << 20, MOST_GROUPS * WORKGROUP, u32::MAX - 64] {
            let [x, y] = workgroups(invocations);
            assert!(x <= MOST_GROUPS && y <= MOST_GROUPS);
            assert!(u64::from(x) * u64::from(y) * 64 >= u64::from(invocations));
        }
    }
}
