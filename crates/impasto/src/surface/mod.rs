//! What a painting is before anyone fits or lights it.
//!
//! A [`Surface`] is a normal, a diffuse reflectance and a few [`Lobe`]s per pixel, all lobes of one
//! [`Model`]. [`predict()`] says which samples it would show to a rig; [`relight`](crate::relight)
//! makes pictures of it; [`sbrdf`](crate::sbrdf) estimates it. A model is a [`LobeModel`]: value
//! only, what an estimation needs besides is its own affair. [`Pairs`] is the one table of lights
//! and views that kernels evaluate models with.

mod lafortune;
mod lobe;
mod lobe_model;
mod maps;
mod model;
mod pairs;
mod predict;
mod reduced;
mod sight;
mod torrance_sparrow;

pub use crate::brdf::coated_diffuse::CoatedDiffuse;
pub use crate::brdf::torrance_sparrow::{GAMMA_MAX, GAMMA_MIN};
pub use lafortune::{Lafortune, LightView};
pub(crate) use lobe::scaled;
pub use lobe::{Lobe, Parameter, Strength};
pub use lobe_model::{LobeModel, MAX_PARAMETERS, Shape};
pub use maps::Surface;
pub use model::{Model, ModelVisitor};
pub use pairs::Pairs;
pub use predict::predict;
pub use reduced::{Reduced, ReducedLobe, reduced};
pub use sight::{Cone, Sight, angle};
pub use torrance_sparrow::TorranceSparrow;
