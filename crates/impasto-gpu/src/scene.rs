//! A scene as the kernels read it: lamps in the order of their colours, colours as columns.

use bytemuck::Zeroable;

use impasto::geometry::{Light, View};
use impasto::relight::curve::Curve;
use impasto::relight::scene::Scene;
use impasto::relight::show::Display;
use impasto::surface::{Lafortune, Model, Pairs, TorranceSparrow};

use crate::layout::Lamp;

/// Linear display light of light.
fn shown_by(display: &Display<'_>, light: [f64; 3]) -> [f64; 3] {
    let columns = display.matrix.iter().zip(light);
    columns.fold([0.0; 3], |sum, (column, part)| {
        [0, 1, 2].map(|channel| column[channel].mul_add(part, sum[channel]))
    })
}

/// The tables of a display's tone curve, one after another.
pub(crate) fn tables(curve: &Curve) -> Vec<[f32; 2]> {
    (0..3).flat_map(|channel| *curve.channel(channel)).collect()
}

/// A light, and its radius: of a distant one in radians, of a near one in mm; 0 without a size.
pub(crate) type Disc = (Light, f64);

/// What is uploaded for a picture.
#[derive(Debug)]
pub(crate) struct Lit {
    /// Lamps, and behind them the points of those with a size.
    pub(crate) lamps: Vec<Lamp>,
    /// How many lamps there are.
    pub(crate) count: u32,
    /// Their lights, and their radii if they have a size, for shadows.
    pub(crate) lights: Vec<Disc>,
    pub(crate) colours: Vec<[f32; 4]>,
    pub(crate) view: [f32; 3],
    pub(crate) near_lights: bool,
    pub(crate) near_view: bool,
    pub(crate) background: [f32; 3],
}

impl Lit {
    /// A scene over a surface; with a display its light is the display's.
    pub(crate) fn of(
        scene: &Scene,
        model: Model,
        background: [f32; 3],
        display: Option<&Display<'_>>,
    ) -> Self {
        let shown = |light: [f64; 3]| display.map_or(light, |display| shown_by(display, light));
        let first_column = |colour: usize| (colour * (scene.coefficients() + 1)) as u32;
        let (mut lamps, mut lights) = (Vec::<Lamp>::new(), Vec::new());
        let mut points = Vec::new();
        for index in 0..scene.colours().len() {
            let colour = first_column(index);
            for lamp in scene.lamps().iter().filter(|lamp| lamp.colour == index) {
                let first = scene.lamps().len() + points.len();
                let seen = lamp.points();
                lamps.push(Lamp {
                    colour,
                    shares: u32::from(lamp.has_size()),
                    points: seen.len() as u32,
                    first_point: first as u32,
                    spread: lamp.spread() as f32,
                    ..paired((lamp.light, lamp.intensity), scene.view(), model)
                });
                lights.push((lamp.light, if lamp.has_size() { lamp.radius } else { 0.0 }));
                if lamp.has_size() {
                    let part = |light| paired((light, lamp.intensity), scene.view(), model);
                    points.extend(seen.into_iter().map(part));
                }
            }
            if let Some(lamp) = lamps.last_mut().filter(|lamp| lamp.colour == colour) {
                lamp.last = 1;
            }
        }
        let count = lamps.len() as u32;
        lamps.extend(points);
        if lamps.is_empty() {
            // Under an environment alone; an empty array cannot be bound.
            lamps.push(Lamp::zeroed());
        }
        let colours = scene.colours().iter().flat_map(|colour| {
            let columns = colour.diffuse.iter().chain(std::iter::once(&colour.interface));
            columns.map(|&column| single(shown(column)))
        });
        let [x, y, z, _] = single(shown(background.map(f64::from)));
        Self {
            colours: colours.collect(),
            near_lights: lights.iter().any(|(light, _)| !light.is_distant()),
            near_view: !scene.view().is_distant(),
            view: match scene.view() {
                View::Distant(towards) | View::Point(towards) => towards.array().map(|v| v as f32),
            },
            background: [x, y, z],
            lamps,
            count,
            lights,
        }
    }
}

fn single([x, y, z]: [f64; 3]) -> [f32; 4] {
    [x as f32, y as f32, z as f32, 0.0]
}

/// A lamp and the eye; what a model derives from both is computed by the model, as for the CPU.
fn paired((light, intensity): (Light, f64), view: View, model: Model) -> Lamp {
    let (towards, near, distance) = match light {
        Light::Distant(towards) => (towards, 0, 0.0),
        Light::Point { position, falloff } => {
            (position, 1, if falloff { position.length() } else { 0.0 })
        }
    };
    let pair = std::iter::once((light, view));
    let (halfway, twice_over_v_h, fresnel, light_view) = match model {
        Model::TorranceSparrow { index } => {
            let pairs = Pairs::<_, f32>::new(TorranceSparrow { index }, pair);
            let facet = pairs.middle(0);
            (facet.half().array(), facet.twice_over_v_h(), facet.fresnel(), 0.0)
        }
        Model::Lafortune => {
            let pairs = Pairs::<_, f32>::new(Lafortune, pair);
            ([0.0; 3], 0.0, 0.0, pairs.middle(0).light_view)
        }
    };
    Lamp {
        towards: towards.array().map(|v| v as f32),
        intensity: intensity as f32,
        halfway,
        twice_over_v_h,
        fresnel,
        light_view,
        distance: distance as f32,
        near,
        ..Lamp::zeroed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use impasto::math::Vec3;
    use impasto::relight::curve::CELLS;
    use impasto::relight::scene;

    #[test]
    fn lamps_stand_in_the_order_of_their_colours() {
        let light = Light::Distant(Vec3::new(0.0, 0.6, 0.8));
        let lamp = |colour| scene::Lamp { light, intensity: 1.0, radius: 0.0, colour };
        let colour = |v| scene::Colour { diffuse: vec![[v; 3]; 2], interface: [v; 3] };
        let lamps = vec![lamp(2), lamp(0), lamp(2)];
        let colours = vec![colour(1.0), colour(2.0), colour(3.0)];
        let scene = Scene::new(lamps, colours, Vec3::new(0.0, 0.0, 1.0)).unwrap();
        let lit = Lit::of(&scene, Model::Lafortune, [0.25; 3], None);
        let order: Vec<_> = lit.lamps.iter().map(|lamp| (lamp.colour, lamp.last)).collect();
        // Each colour has two columns of coefficients and one of its own.
        assert_eq!(order, [(0, 1), (6, 0), (6, 1)]);
        assert_eq!(lit.colours.len(), 9);
        assert!((lit.lamps[0].light_view - 0.8).abs() < 1e-6);
        let ramp: Vec<f32> = (0..=CELLS).map(|i| i as f32 / CELLS as f32).collect();
        let curve = Curve::new(&ramp).unwrap();
        // Columns.
        let matrix = [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [4.0, 0.0, 0.0]];
        let display = Display { matrix: &matrix, curve: &curve };
        let lit = Lit::of(&scene, Model::Lafortune, [0.25; 3], Some(&display));
        assert_eq!(lit.colours[0], [4.0, 0.0, 2.0, 0.0]);
        assert_eq!(lit.background, [1.0, 0.0, 0.5]);
        assert_eq!(tables(&curve).len(), 3 * CELLS);
    }
}
