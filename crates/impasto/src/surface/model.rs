//! The models of lobes as one type: what a caller names, and a GPU switches on.

use super::lafortune::Lafortune;
use super::lobe_model::{LobeModel, Shape};
use super::sight::Sight;
use super::torrance_sparrow::TorranceSparrow;
use crate::error::{Error, Result};

/// A model of lobes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Model {
    /// Facets under an interface: [`TorranceSparrow`].
    TorranceSparrow {
        /// Index of refraction.
        index: f64,
    },
    /// [`Lafortune`].
    Lafortune,
}

/// Something to do with a model that the compiler knows.
pub trait ModelVisitor {
    /// What it returns.
    type Output;
    /// Does it.
    fn visit<M: LobeModel>(self, model: M) -> Self::Output;
}

impl Model {
    /// The model of a name; `index` is the index of refraction where the model has one.
    ///
    /// # Errors
    /// If there is no model of this name.
    pub fn from_name(name: &str, index: f64) -> Result<Self> {
        match name {
            "torrance-sparrow" => Ok(Self::TorranceSparrow { index }),
            "lafortune" => Ok(Self::Lafortune),
            other => {
                let problem =
                    format!("expected \"torrance-sparrow\" or \"lafortune\", found {other:?}");
                Err(Error::argument("model", problem))
            }
        }
    }

    /// Calls `visitor` with the model as a type, so that each model has kernels of its own.
    pub fn visit<V: ModelVisitor>(self, visitor: V) -> V::Output {
        match self {
            Self::TorranceSparrow { index } => visitor.visit(TorranceSparrow { index }),
            Self::Lafortune => visitor.visit(Lafortune),
        }
    }

    /// [`LobeModel::most`] of the model.
    #[must_use]
    pub fn most(self, shape: &Shape, sight: &Sight) -> f64 {
        struct Most<'a>(&'a Shape, &'a Sight);
        impl ModelVisitor for Most<'_> {
            type Output = f64;
            fn visit<M: LobeModel>(self, model: M) -> f64 {
                model.most(self.0, self.1)
            }
        }
        self.visit(Most(shape, sight))
    }

    /// The names of a lobe's parameters.
    #[must_use]
    pub fn names(self) -> &'static [&'static str] {
        struct Names;
        impl ModelVisitor for Names {
            type Output = &'static [&'static str];
            fn visit<M: LobeModel>(self, _: M) -> Self::Output {
                M::NAMES
            }
        }
        self.visit(Names)
    }
}
