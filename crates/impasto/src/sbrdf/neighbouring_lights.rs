//! Which lights are near which: errors of a model are alike under neighbouring lights, noise is not.

use core::f64::consts::TAU;

use crate::geometry::Rig;

/// Sectors of azimuth. They do not depend on what other photographs there are, so that one without
/// any sample changes nothing.
pub(super) const SECTORS: usize = 8;

/// Azimuth at which the first sector begins, rad: no whole number of degrees, and of no dome whose
/// lights are evenly spaced.
const FIRST: f64 = 0.1;

/// The sectors of the lights, and each light's nearest ones.
#[derive(Clone, Debug)]
pub(super) struct NeighbouringLights {
    /// Sector of each light.
    pub(super) sector: Vec<usize>,
    /// All other lights of each light, the nearest first.
    pub(super) nearest: Vec<Vec<usize>>,
}

impl NeighbouringLights {
    /// By the lights' directions from the middle of the painting: every tile has the same.
    pub(super) fn new(rig: &Rig) -> Self {
        let lights: Vec<_> = rig.lights().iter().map(|l| l.direction().normalised()).collect();
        let sector = |azimuth: f64| {
            let turn = ((azimuth - FIRST) / TAU).rem_euclid(1.0);
            ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
        };
        let nearest = |light: usize| {
            let mut others: Vec<_> = (0..lights.len()).filter(|&other| other != light).collect();
            let near = |other: usize| lights[light].dot(lights[other]);
            others.sort_by(|&a, &b| near(b).total_cmp(&near(a)));
            others
        };
        Self {
            sector: lights.iter().map(|light| sector(light.y.atan2(light.x))).collect(),
            nearest: (0..lights.len()).map(nearest).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Grid, Light, View};
    use crate::math::Vec3;

    fn ring(count: usize) -> NeighbouringLights {
        let lights = (0..count).map(|light| {
            let azimuth = TAU * light as f64 / count as f64;
            Light::Distant(Vec3::new(azimuth.cos(), azimuth.sin(), 1.0))
        });
        let views = vec![View::Distant(Vec3::new(0.0, 0.0, 1.0)); count];
        let rig = Rig::new(lights.collect(), views, Grid::whole(1, 1, 1.0)).unwrap();
        NeighbouringLights::new(&rig)
    }

    #[test]
    fn sectors_of_a_ring_are_equal() {
        for count in [8, 16, 24, 40] {
            let lights = ring(count);
            for sector in 0..SECTORS {
                let members = lights.sector.iter().filter(|&&one| one == sector).count();
                assert_eq!(members, count / SECTORS, "{count}");
            }
        }
    }

    #[test]
    fn the_nearest_lights_of_a_ring_are_beside() {
        let lights = ring(16);
        for (light, nearest) in lights.nearest.iter().enumerate() {
            assert_eq!(nearest.len(), 15);
            let mut two = [nearest[0], nearest[1]];
            two.sort_unstable();
            let mut beside = [(light + 1) % 16, (light + 15) % 16];
            beside.sort_unstable();
            assert_eq!(two, beside);
        }
    }
}
