//! Pictures of a surface made by a graphics card: `impasto::relight` in WGSL, through wgpu.
//!
//! A [`Renderer`] uploads a surface once and shows it under scene after scene; [`render`] shows one
//! picture, band by band, of a painting of any size. Both give what `impasto::relight::render`
//! gives, or 8-bit codes of a display. There is one shader file per stage of the CPU, under the same
//! name; they are joined into one kernel, compiled per choice of effects.
//!
//! Vulkan, Metal and DirectX 12 serve. Everything that can fail there is an [`Error`] with an
//! explanation: whoever called goes on with the CPU.

#![deny(unsafe_code)]
#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "citations such as [@wolff1994diffuse] look like links; they are keys of docs/references.bib"
)]

mod adapter;
mod device;
mod environment;
mod error;
mod layout;
mod pipeline;
mod planes;
mod renderer;
mod scene;
mod shadow;

pub use adapter::{Adapter, Choice, Kind, adapters};
pub use device::Gpu;
pub use error::{Error, Result};
pub use renderer::{Renderer, Screen, render};
