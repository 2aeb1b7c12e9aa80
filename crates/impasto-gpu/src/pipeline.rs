//! The kernels: WGSL files, one per stage of the CPU, joined into one, compiled per variant.
//!
//! What a scene calls for is a set of `override` constants: the compiler of the driver sees numbers
//! and drops what is off.

use std::sync::OnceLock;

use wgpu::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType,
    BufferBindingType, ComputePipeline, ComputePipelineDescriptor, Device,
    PipelineCompilationOptions, PipelineLayoutDescriptor, ShaderModuleDescriptor, ShaderSource,
    ShaderStages,
};

/// The stages before an environment, in the order in which they are joined.
const STAGES: [&str; 10] = [
    include_str!("shaders/frame.wgsl"),
    include_str!("shaders/elementary.wgsl"),
    include_str!("shaders/reach.wgsl"),
    include_str!("shaders/visible.wgsl"),
    include_str!("shaders/diffuse.wgsl"),
    include_str!("shaders/specular_torrance_sparrow.wgsl"),
    include_str!("shaders/specular_lafortune.wgsl"),
    include_str!("shaders/specular.wgsl"),
    include_str!("shaders/ambient.wgsl"),
    include_str!("shaders/colour.wgsl"),
];

/// An environment.
const ENVIRONMENT: [&str; 6] = [
    include_str!("shaders/environment/table.wgsl"),
    include_str!("shaders/environment/irradiance.wgsl"),
    include_str!("shaders/environment/torrance_sparrow.wgsl"),
    include_str!("shaders/environment/scalar.wgsl"),
    include_str!("shaders/environment/lafortune.wgsl"),
    include_str!("shaders/environment/stage.wgsl"),
];

/// None: a kernel without one is compiled from a text without one, in a third of the time.
const ABSENT: &str = include_str!("shaders/environment/absent.wgsl");

/// The stages after it.
const SHOWN: [&str; 2] = [include_str!("shaders/curve.wgsl"), include_str!("shaders/render.wgsl")];

/// The text of the kernel of pictures, with an environment or without.
fn text(environment: bool) -> String {
    let around = if environment { ENVIRONMENT.concat() } else { ABSENT.to_owned() };
    [&STAGES.concat(), &around, &SHOWN.concat()].map(String::as_str).concat()
}

/// Cast shadows, by themselves.
const SHADOW: &str = include_str!("shaders/shadow.wgsl");

/// What is compiled once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Kernel {
    /// Light or codes of every pixel.
    Render(Variant),
    /// How deep in shadow, along the light's lines.
    Sweep,
    /// Which pixels see the light.
    Lit,
}

/// What a picture calls for: one `override` constant each, but for the environment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[allow(clippy::struct_excessive_bools, reason = "each is a switch of the shaders")]
pub(crate) struct Variant {
    pub(crate) model: u32,
    pub(crate) lobes: u32,
    pub(crate) strength_maps: u32,
    pub(crate) tinted: u32,
    pub(crate) shape_maps: u32,
    pub(crate) coefficients: u32,
    pub(crate) one_lamp: bool,
    pub(crate) near_lights: bool,
    pub(crate) near_view: bool,
    pub(crate) coated: bool,
    pub(crate) ambient: bool,
    pub(crate) shadows: bool,
    pub(crate) sized_lamps: bool,
    pub(crate) environment: bool,
    pub(crate) sky: bool,
    pub(crate) scalar: bool,
    pub(crate) codes: bool,
}

impl Variant {
    fn constants(&self) -> [(&'static str, f64); 16] {
        let flag = |on: bool| f64::from(u8::from(on));
        [
            ("MODEL", self.model.into()),
            ("LOBES", self.lobes.into()),
            ("STRENGTH_MAPS", self.strength_maps.into()),
            ("TINTED", self.tinted.into()),
            ("SHAPE_MAPS", self.shape_maps.into()),
            ("COEFFICIENTS", self.coefficients.into()),
            ("ONE_LAMP", flag(self.one_lamp)),
            ("NEAR_LIGHTS", flag(self.near_lights)),
            ("NEAR_VIEW", flag(self.near_view)),
            ("COATED", flag(self.coated)),
            ("AMBIENT", flag(self.ambient)),
            ("SHADOWS", flag(self.shadows)),
            ("SIZED_LAMPS", flag(self.sized_lamps)),
            ("SKY", flag(self.sky)),
            ("SCALAR", flag(self.scalar)),
            ("CODES", flag(self.codes)),
        ]
    }
}

/// The shaders of an open device, and how their arrays are bound.
#[derive(Debug)]
pub(crate) struct Modules {
    render: wgpu::ShaderModule,
    /// The same in an environment, made when it is first asked for.
    surrounded: OnceLock<wgpu::ShaderModule>,
    shadow: wgpu::ShaderModule,
    of_render: Binding,
    of_shadow: Binding,
}

#[derive(Debug)]
struct Binding {
    group: BindGroupLayout,
    pipeline: wgpu::PipelineLayout,
}

/// A kernel's arrays after its uniform: how many it reads, then how many it writes; and the uniforms
/// after these. Any device reads and writes eight arrays.
const OF_RENDER: [usize; 3] = [7, 1, 1];
const OF_SHADOW: [usize; 3] = [2, 2, 0];

impl Modules {
    pub(crate) fn new(device: &Device) -> Self {
        Self {
            render: module(device, "render", text(false)),
            surrounded: OnceLock::new(),
            shadow: module(device, "shadow", SHADOW.to_owned()),
            of_render: Binding::new(device, OF_RENDER),
            of_shadow: Binding::new(device, OF_SHADOW),
        }
    }

    fn binding(&self, kernel: Kernel) -> &Binding {
        match kernel {
            Kernel::Render(_) => &self.of_render,
            Kernel::Sweep | Kernel::Lit => &self.of_shadow,
        }
    }

    pub(crate) fn layout(&self, kernel: Kernel) -> &BindGroupLayout {
        &self.binding(kernel).group
    }

    pub(crate) fn pipeline(&self, device: &Device, kernel: Kernel) -> ComputePipeline {
        let render = |environment: bool| {
            let surrounded = || module(device, "render in an environment", text(true));
            if environment { self.surrounded.get_or_init(surrounded) } else { &self.render }
        };
        let (module, entry, constants) = match kernel {
            Kernel::Render(variant) => {
                (render(variant.environment), "render", variant.constants().to_vec())
            }
            Kernel::Sweep => (&self.shadow, "sweep", Vec::new()),
            Kernel::Lit => (&self.shadow, "lit", Vec::new()),
        };
        device.create_compute_pipeline(&ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(&self.binding(kernel).pipeline),
            module,
            entry_point: Some(entry),
            compilation_options: PipelineCompilationOptions {
                constants: &constants,
                zero_initialize_workgroup_memory: false,
            },
            cache: None,
        })
    }
}

fn module(device: &Device, label: &str, text: String) -> wgpu::ShaderModule {
    let source = ShaderSource::Wgsl(text.into());
    device.create_shader_module(ShaderModuleDescriptor { label: Some(label), source })
}

impl Binding {
    fn new(device: &Device, [read, written, more]: [usize; 3]) -> Self {
        let uniform = BufferBindingType::Uniform;
        let storage = |read_only| BufferBindingType::Storage { read_only };
        let kinds = std::iter::once(uniform)
            .chain(std::iter::repeat_n(storage(true), read))
            .chain(std::iter::repeat_n(storage(false), written))
            .chain(std::iter::repeat_n(uniform, more));
        let entries: Vec<_> = (0..)
            .zip(kinds)
            .map(|(binding, ty)| BindGroupLayoutEntry {
                binding,
                visibility: ShaderStages::COMPUTE,
                ty: BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
                count: None,
            })
            .collect();
        let group = device.create_bind_group_layout(&BindGroupLayoutDescriptor {
            label: None,
            entries: &entries,
        });
        let pipeline = device.create_pipeline_layout(&PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&group)],
            immediate_size: 0,
        });
        Self { group, pipeline }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use naga::back::pipeline_constants::process_overrides;
    use naga::back::spv;
    use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
    use naga::{Module, ShaderStage};

    fn parsed(text: &str) -> (Module, ModuleInfo) {
        let module = naga::front::wgsl::parse_str(text)
            .unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)));
        let info = Validator::new(ValidationFlags::all(), Capabilities::default())
            .validate(&module)
            .unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)));
        (module, info)
    }

    /// Length in words of the SPIR-V of an entry point.
    fn compiled((module, info): &(Module, ModuleInfo), entry: &str, variant: Variant) -> usize {
        let constants =
            variant.constants().into_iter().map(|(name, value)| (name.to_owned(), value));
        let constants: naga::back::PipelineConstants =
            constants.filter(|_| entry == "render").collect();
        let stage = (ShaderStage::Compute, entry);
        let (module, info) = process_overrides(module, info, Some(stage), &constants)
            .unwrap_or_else(|error| panic!("{variant:?}: {error}"));
        let options = spv::PipelineOptions {
            shader_stage: ShaderStage::Compute,
            entry_point: entry.to_owned(),
        };
        spv::write_vec(&module, &info, &spv::Options::default(), Some(&options))
            .unwrap_or_else(|error| panic!("{variant:?}: {error}"))
            .len()
    }

    /// Every choice of switches with none, one, three and all lobes, whose numbers are maps for none,
    /// for every other and for all. In an environment, with a sky that is hidden and with scalars, too,
    /// the switches of stages that have nothing in common with it go with those that have.
    fn variants() -> Vec<Variant> {
        let mut all = Vec::new();
        for switches in 0..256_u32 {
            let on = |bit: u32| switches >> bit & 1 != 0;
            for (around, model) in (0..5).flat_map(|around| [(around, 0), (around, 1)]) {
                let (environment, sky, scalar) = (around > 0, around % 2 == 0, around > 2);
                for lobes in [0, 1, 3, 8] {
                    let together = [(0, 7), (3, 5), (4, 1), (6, 2)];
                    let apart = together.into_iter().any(|(one, other)| on(one) != on(other));
                    if environment && apart || scalar && (model == 0 || lobes == 0) {
                        continue;
                    }
                    for (strength_maps, tinted, shape_maps) in
                        [(0, 0, 0), (0x55, 0xaa, 0x55_5555), (0, 0xff, 0xff_ffff), (0xff, 0, 0)]
                    {
                        all.push(Variant {
                            model,
                            lobes,
                            strength_maps,
                            tinted,
                            shape_maps,
                            coefficients: [1, 3, 6][(switches % 3) as usize],
                            one_lamp: on(6),
                            near_lights: on(0),
                            near_view: on(1),
                            coated: on(2),
                            ambient: on(3),
                            shadows: on(4),
                            sized_lamps: on(7),
                            environment,
                            sky: environment && sky,
                            scalar,
                            codes: on(5),
                        });
                    }
                }
            }
        }
        all
    }

    #[test]
    fn every_variant_compiles() {
        let kernels = [parsed(&text(false)), parsed(&text(true))];
        for variant in variants() {
            let kernel = &kernels[usize::from(variant.environment)];
            assert!(compiled(kernel, "render", variant) > 0);
        }
        let shadow = parsed(SHADOW);
        for entry in ["sweep", "lit"] {
            assert!(compiled(&shadow, entry, Variant::default()) > 0);
        }
    }

    #[test]
    fn every_constant_exists_and_no_other() {
        let mut given: Vec<_> =
            Variant::default().constants().iter().map(|(name, _)| (*name).to_owned()).collect();
        given.sort();
        for environment in [false, true] {
            let (module, _) = parsed(&text(environment));
            let mut declared: Vec<_> =
                module.overrides.iter().filter_map(|(_, one)| one.name.clone()).collect();
            declared.sort();
            assert_eq!(declared, given);
        }
    }

    #[test]
    fn structures_have_the_size_that_the_shaders_declare() {
        use crate::layout::{Around, Displacement, Frame, Lamp, Layout, Sweep, Widths};
        let (render, _) = parsed(&text(true));
        let (shadow, _) = parsed(SHADOW);
        let size = |module: &Module, name: &str| {
            let layouter = {
                let mut layouter = naga::proc::Layouter::default();
                layouter.update(module.to_ctx()).unwrap();
                layouter
            };
            let (handle, _) =
                module.types.iter().find(|(_, one)| one.name.as_deref() == Some(name)).unwrap();
            layouter[handle].size as usize
        };
        assert_eq!(size(&render, "Frame"), size_of::<Frame>());
        assert_eq!(size(&render, "Lamp"), size_of::<Lamp>());
        assert_eq!(size(&render, "Layout"), size_of::<Layout>());
        assert_eq!(size(&render, "Widths"), size_of::<Widths>());
        assert_eq!(size(&render, "Around"), size_of::<Around>());
        assert_eq!(size(&shadow, "Sweep"), size_of::<Sweep>());
        assert_eq!(size(&shadow, "Displacement"), size_of::<Displacement>());
    }
}
