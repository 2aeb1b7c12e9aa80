//! Which graphics cards there are, and which one to take.

use wgpu::{Backends, DeviceType, InstanceFlags, MemoryBudgetThresholds};

use crate::error::{Error, Result};

/// Of the memory that the driver says a process may use, this share: beyond it an allocation is
/// refused with an error, where drivers would move memory about or end the process.
const MEMORY_PERCENT: u8 = 90;

/// What kind of graphics card.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// With memory of its own.
    Discrete,
    /// A part of the processor, with its memory.
    Integrated,
    /// A share of a card.
    Virtual,
    /// The driver does not say.
    Other,
    /// No card: a driver that computes on the CPU, as Mesa's lavapipe.
    Cpu,
}

impl Kind {
    fn of(device: DeviceType) -> Self {
        match device {
            DeviceType::DiscreteGpu => Self::Discrete,
            DeviceType::IntegratedGpu => Self::Integrated,
            DeviceType::VirtualGpu => Self::Virtual,
            DeviceType::Other => Self::Other,
            DeviceType::Cpu => Self::Cpu,
        }
    }

    /// Its name in lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Other => "other",
            Self::Cpu => "cpu",
        }
    }
}

/// A graphics card as its driver describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// The card's name.
    pub name: String,
    /// What kind of card.
    pub kind: Kind,
    /// The interface: `"vulkan"`, `"metal"` or `"dx12"`.
    pub backend: &'static str,
    /// The driver with its version.
    pub driver: String,
    /// Bytes of the largest array that a kernel reads; larger paintings are rendered in bands.
    pub largest_binding: u64,
}

impl Adapter {
    pub(crate) fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        Self {
            name: info.name,
            kind: Kind::of(info.device_type),
            backend: info.backend.to_str(),
            driver: [info.driver, info.driver_info].join(" ").trim().to_owned(),
            largest_binding: adapter.limits().max_storage_buffer_binding_size,
        }
    }
}

/// Which card is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice<'a> {
    /// The best card, but none that computes on the CPU: our own renderer is faster there.
    Hardware,
    /// The best one, also a driver that computes on the CPU.
    Any,
    /// The best one whose name contains this, in any case.
    Named(&'a str),
}

impl Choice<'_> {
    fn takes(self, adapter: &Adapter) -> bool {
        match self {
            Self::Hardware => adapter.kind != Kind::Cpu,
            Self::Any => true,
            Self::Named(part) => adapter.name.to_lowercase().contains(&part.to_lowercase()),
        }
    }
}

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = Backends::VULKAN | Backends::METAL | Backends::DX12;
    // No validation layers: they are not installed where the painting is looked at.
    descriptor.flags = InstanceFlags::empty();
    descriptor.memory_budget_thresholds = MemoryBudgetThresholds {
        for_resource_creation: Some(MEMORY_PERCENT),
        for_device_loss: None,
    };
    wgpu::Instance::new(descriptor)
}

/// All cards, the best first. A card that cannot run compute shaders is not among them.
fn found() -> Vec<(Adapter, wgpu::Adapter)> {
    let all = pollster::block_on(instance().enumerate_adapters(Backends::all()));
    let mut found: Vec<_> = all
        .into_iter()
        .filter(|adapter| adapter.get_downlevel_capabilities().is_webgpu_compliant())
        .map(|adapter| (Adapter::of(&adapter), adapter))
        .collect();
    found.sort_by_key(|(adapter, _)| adapter.kind);
    found
}

/// All graphics cards that can render, the best first.
#[must_use]
pub fn adapters() -> Vec<Adapter> {
    found().into_iter().map(|(adapter, _)| adapter).collect()
}

pub(crate) fn chosen(choice: Choice<'_>) -> Result<(Adapter, wgpu::Adapter)> {
    let mut all = found();
    match all.iter().position(|(adapter, _)| choice.takes(adapter)) {
        Some(place) => Ok(all.swap_remove(place)),
        None => Err(Error::NoAdapter(missing(choice, all.into_iter().map(|(adapter, _)| adapter)))),
    }
}

/// What to say where no card serves.
fn missing(choice: Choice<'_>, others: impl Iterator<Item = Adapter>) -> String {
    let others: Vec<String> =
        others.map(|adapter| format!("{} ({})", adapter.name, adapter.kind.name())).collect();
    let wanted = match choice {
        Choice::Named(name) => format!("no adapter whose name contains {name:?}"),
        Choice::Hardware | Choice::Any if others.is_empty() => {
            return "no Vulkan, Metal or DirectX 12 adapter was found; install the driver of the \
                    graphics card (on Debian, apt install mesa-vulkan-drivers), or use \
                    backend=\"cpu\""
                .to_owned();
        }
        Choice::Hardware | Choice::Any => "no adapter is a graphics card".to_owned(),
    };
    let there =
        if others.is_empty() { "none was found".to_owned() } else { others.join(", ") + " found" };
    format!("{wanted}: {there}; name another one, or use backend=\"cpu\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, kind: Kind) -> Adapter {
        Adapter {
            name: name.into(),
            kind,
            backend: "vulkan",
            driver: String::new(),
            largest_binding: 1,
        }
    }

    #[test]
    fn software_is_taken_only_where_it_is_wanted() {
        let software = adapter("llvmpipe (LLVM 15)", Kind::Cpu);
        assert!(!Choice::Hardware.takes(&software));
        assert!(Choice::Any.takes(&software));
        assert!(Choice::Named("LLVMpipe").takes(&software));
        assert!(!Choice::Named("radeon").takes(&software));
        assert!(Choice::Hardware.takes(&adapter("Radeon", Kind::Discrete)));
        assert!(Kind::Discrete < Kind::Integrated && Kind::Other < Kind::Cpu);
    }

    #[test]
    fn what_is_missing_is_said_with_what_to_do() {
        let nothing = missing(Choice::Any, std::iter::empty());
        assert!(nothing.contains("mesa-vulkan-drivers") && nothing.contains("backend=\"cpu\""));
        let software = || std::iter::once(adapter("llvmpipe", Kind::Cpu));
        assert!(missing(Choice::Hardware, software()).contains("llvmpipe (cpu) found"));
        assert!(missing(Choice::Named("x"), std::iter::empty()).contains("none was found"));
    }
}
