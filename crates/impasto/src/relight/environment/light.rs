//! An environment, ready to light paintings: its texels, and what does not depend on the painting.

use super::irradiance::Irradiance;
use super::lafortune::Prefiltered;
use super::map::Map;
use super::scalar::Scheme;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::pixels::Run;

/// Changes when the numbers of [`Environment::lobes`] do, for whoever keeps them.
pub const LOBES_VERSION: u32 = 2;

/// Distant light from all directions in front of the painting, in three channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    pub(crate) map: Map,
    pub(crate) irradiance: Irradiance,
    pub(crate) lobes: Option<Prefiltered>,
    pub(crate) scheme: Scheme,
}

impl Environment {
    /// An environment of a map, its irradiance tabulated.
    ///
    /// # Errors
    /// If the caller cancels.
    pub fn new(map: Map, run: &Run<'_>) -> Result<Self> {
        let irradiance = Irradiance::new(&map, None, run)?;
        Ok(Self { map, irradiance, lobes: None, scheme: Scheme::Vector })
    }

    /// The same with maps for Lafortune lobes, which take a second or two.
    ///
    /// # Errors
    /// If the caller cancels.
    pub fn with_lobes(mut self, run: &Run<'_>) -> Result<Self> {
        self.lobes = Some(Prefiltered::new(&self.map, run)?);
        Ok(self)
    }

    /// The same with the maps that [`Self::lobes`] gave before.
    ///
    /// # Errors
    /// If these are not so many finite numbers.
    pub fn with_kept_lobes(mut self, nodes: Vec<f32>) -> Result<Self> {
        self.lobes = Some(Prefiltered::from_nodes(nodes)?);
        Ok(self)
    }

    /// The same by another scheme of lobes.
    #[must_use]
    pub fn with_scheme(mut self, scheme: Scheme) -> Self {
        self.scheme = scheme;
        self
    }

    /// By which scheme Lafortune lobes are lit.
    #[must_use]
    pub fn scheme(&self) -> Scheme {
        self.scheme
    }

    /// The numbers of the maps for Lafortune lobes, if they are there.
    #[must_use]
    pub fn lobes(&self) -> Option<&[f32]> {
        self.lobes.as_ref().map(Prefiltered::nodes)
    }

    /// Irradiance of a facet per channel: 1 is a white board shown as white.
    ///
    /// # Errors
    /// If the normal is no finite vector that faces the viewer.
    pub fn irradiance(&self, normal: Vec3<f64>, run: &Run<'_>) -> Result<[f64; 3]> {
        if !(normal.length_squared().is_finite() && normal.z > 0.0) {
            return Err(Error::geometry("normal", format!("it faces away (z is {})", normal.z)));
        }
        Ok(self.irradiance.of(normal.normalised(), run))
    }
}
