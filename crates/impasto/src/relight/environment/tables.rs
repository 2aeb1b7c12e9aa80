//! All that is looked up of an environment over a surface, whatever the pixel: for [`stage`](super::stage),
//! and as arrays of nodes for a renderer that looks up elsewhere.

use std::borrow::Cow;

use super::irradiance::Irradiance;
use super::lafortune::Prefiltered;
use super::light::Environment;
use super::table::Nodes;
use super::torrance_sparrow::{Glossy, Widths};
use crate::error::Result;
use crate::geometry::View;
use crate::pixels::Run;
use crate::surface::{Model, Surface, TorranceSparrow};

/// Tables of an environment for one surface and one eye.
pub struct Tables<'a> {
    /// The environment's own, or that of light which crosses an interface.
    pub(super) irradiance: Cow<'a, Irradiance>,
    pub(super) lobes: Lobes<'a>,
}

pub(super) enum Lobes<'a> {
    None,
    Glossy(Vec<Glossy<'a>>),
    Lafortune(Box<Cow<'a, Prefiltered>>),
}

impl<'a> Tables<'a> {
    /// The tables that a surface needs, seen by an eye.
    ///
    /// Of the surface the model, the interface, the number of lobes and, of a Torrance-Sparrow model,
    /// normals and gammas are read.
    ///
    /// # Errors
    /// If the caller cancels.
    pub fn new(
        surface: &'a Surface<'a>,
        environment: &'a Environment,
        view: View,
        run: &Run<'_>,
    ) -> Result<Self> {
        let irradiance = match surface.coated {
            None => Cow::Borrowed(&environment.irradiance),
            Some(_) => Cow::Owned(Irradiance::new(&environment.map, surface.coated, run)?),
        };
        let lobes = match surface.model {
            _ if surface.lobes.is_empty() => Lobes::None,
            Model::Lafortune => Lobes::Lafortune(Box::new(match &environment.lobes {
                Some(maps) => Cow::Borrowed(maps),
                None => Cow::Owned(Prefiltered::new(&environment.map, run)?),
            })),
            Model::TorranceSparrow { index } => {
                // Tabulated for one direction of the eye: that from the middle of the painting.
                let seen = (TorranceSparrow { index }, view.direction());
                let glossy = |lobe| Glossy::new(lobe, &environment.map, seen, surface.normal, run);
                Lobes::Glossy(surface.lobes.iter().map(glossy).collect::<Result<_>>()?)
            }
        };
        Ok(Self { irradiance, lobes })
    }

    /// Irradiance by the normal, without what [`Self::bright`] sheds.
    #[must_use]
    pub fn irradiance(&self) -> Nodes<'_> {
        self.irradiance.nodes()
    }

    /// Texels that light the diffuse part as distant lamps: direction, and irradiance at normal
    /// incidence per channel.
    pub fn bright(&self) -> impl Iterator<Item = ([f32; 3], [f32; 3])> + '_ {
        self.irradiance.bright()
    }

    /// Of Torrance-Sparrow lobes: tables lobe by lobe.
    #[must_use]
    pub fn widths(&self) -> Vec<Widths<'_>> {
        match &self.lobes {
            Lobes::Glossy(lobes) => lobes.iter().map(Glossy::widths).collect(),
            Lobes::None | Lobes::Lafortune(_) => Vec::new(),
        }
    }

    /// Of Lafortune lobes: one table for all, at every half octave of the exponent from 1/2 on.
    #[must_use]
    pub fn prefiltered(&self) -> Vec<Nodes<'_>> {
        match &self.lobes {
            Lobes::Lafortune(maps) => maps.tables().collect(),
            Lobes::None | Lobes::Glossy(_) => Vec::new(),
        }
    }
}
