//! What was decided, row by row, with reasons.

use super::{
    BOUNCE, Decided, Decision, Effect, LIT, NEAR, Row, SHADED, SKY, Work, lobe_bit, moves_heights,
};
use crate::relight::bounds;

impl Work<'_> {
    pub(super) fn rows(
        &self,
        parts: &[u32],
        decided: &[Decided],
        (shadows, wanted): (String, bool),
        (slanted, moved): (f64, &Row),
        sky: &(Vec<u8>, String),
    ) -> Vec<Row> {
        let Self { surface, scene, options, .. } = self;
        let (lamps, all) = (scene.lamps().len(), decided.len());
        let unit = options.tolerance.unit();
        let tiles_with = |bit: u32| {
            let needs = |parts: &&[u32]| parts.iter().any(|part| part & bit != 0);
            // In an environment there may be no lamp.
            parts.chunks(lamps.max(1)).filter(needs).count()
        };
        let lost = |which: usize| {
            let lost = decided.iter().flat_map(|tile| &tile.lost);
            let errors = lost.filter(|(one, _)| *one == which).map(|(_, error)| *error);
            errors.fold((0.0, false), |(most, _), error| (error.max(most), true))
        };
        let mut rows = Vec::new();
        let mut row = |effect, decision, tiles, error, reason: String| {
            rows.push(Row { effect, decision, tiles, error, reason });
        };
        let there = |present: bool, name: &str| {
            if present {
                (Decision::On, all, format!("the surface has {name}"))
            } else {
                (Decision::Absent, 0, format!("the surface has no {name}"))
            }
        };
        let around = scene.environment().is_some();
        let lit = tiles_with(LIT);
        let (decision, tiles, reason) = match (around, lit) {
            (true, _) => (Decision::On, all, "an environment lights every tile".to_owned()),
            (false, 0) => (Decision::NoOp, 0, "no normal faces a lamp".to_owned()),
            _ => (Decision::On, lit, format!("some normal faces a lamp in {lit} of {all} tiles")),
        };
        row(Effect::Diffuse, decision, tiles, 0.0, reason);
        let (decision, tiles, reason) = there(surface.coated.is_some(), "interface over its paint");
        row(Effect::CoatedDiffuse, decision, tiles, 0.0, reason);
        let (decision, tiles, reason) = match there(surface.ambient.is_some(), "ambient light") {
            (Decision::On, ..) if lamps == 0 => {
                (Decision::NoOp, 0, "ambient light is that of lamps".to_owned())
            }
            other => other,
        };
        row(Effect::Ambient, decision, tiles, 0.0, reason);
        for lobe in 0..surface.lobes.len() {
            let tiles = if around { all } else { tiles_with(lobe_bit(lobe)) };
            let (error, dropped) = lost(lobe.min(28));
            let (decision, reason) = match (tiles, dropped) {
                (0, false) => (Decision::NoOp, "0 in every tile".to_owned()),
                (0, true) => {
                    (Decision::Bounded, format!("at most {error:.3} {unit} in every tile"))
                }
                _ => (Decision::On, format!("can be seen in {tiles} of {all} tiles")),
            };
            row(Effect::Lobe(lobe), decision, tiles, error, reason);
        }
        let tiles = tiles_with(SHADED);
        let decision = match (wanted, tiles) {
            (false, _) => Decision::Absent,
            (true, 0) => Decision::NoOp,
            _ => Decision::On,
        };
        row(Effect::CastShadows, decision, tiles, 0.0, shadows);
        let near = scene.lamps().iter().any(|lamp| !lamp.light.is_distant());
        let tiles = tiles_with(NEAR);
        let (error, dropped) = lost(surface.lobes.len());
        let (decision, reason) = match (near, tiles) {
            (false, _) => (Decision::Absent, "every lamp is distant".to_owned()),
            (true, 0) if !dropped => (Decision::NoOp, "no normal faces a lamp".to_owned()),
            (true, 0) => (Decision::Bounded, format!("at most {error:.3} {unit} in every tile")),
            _ => (Decision::On, format!("directions differ in {tiles} of {all} tiles")),
        };
        row(Effect::NearLight, decision, tiles, error, reason);
        let lobed = (around && !surface.lobes.is_empty())
            || parts.iter().any(|part| part & !(LIT | SHADED | NEAR) != 0);
        let (decision, tiles, reason) = match (scene.view().is_distant(), lobed) {
            (true, _) => (Decision::Absent, 0, "the eye is distant"),
            (false, false) if surface.coated.is_none() => {
                (Decision::NoOp, 0, "no lobe and no coat sees where the eye is")
            }
            _ => (Decision::On, all, "lobes see the eye from each pixel"),
        };
        row(Effect::NearView, decision, tiles, 0.0, reason.to_owned());
        let (decision, tiles, reason) = if slanted > 0.0 {
            let reason = format!("the view moves a corner by {slanted:.2e} pixels");
            (Decision::On, all, reason)
        } else {
            (Decision::Absent, 0, "the view moves no pixel".to_owned())
        };
        row(Effect::SlantedView, decision, tiles, 0.0, reason);
        rows.push(moved.clone());
        rows.extend(self.rows_of_environment(all, sky));
        rows
    }

    /// Whether the relief moves what is seen.
    pub(super) fn moved(&self, slanted: f64) -> Row {
        let Self { statistics, grid, scene, options, .. } = self;
        let ranges = statistics.tiles.iter().filter_map(|tile| tile.relief.as_ref());
        let highest = ranges.map(|relief| relief.height.largest()).fold(0.0, f64::max);
        let most = bounds::steepest_view(scene.view(), *grid);
        let pixels = highest * most / grid.pitch;
        let moves = moves_heights(scene, slanted);
        let (decision, tiles, reason) = match (moves, options.over.parallax) {
            (false, _) => (Decision::Absent, 0, "the view moves no pixel".to_owned()),
            (_, false) => (Decision::Absent, 0, "no relief".to_owned()),
            // Straight in front the picture is resampled for heights alone.
            _ if highest == 0.0 && slanted > 0.0 => {
                (Decision::NoOp, 0, "the relief is flat".to_owned())
            }
            _ => {
                let reason = format!("heights move what is seen by up to {pixels:.2} pixels");
                (Decision::On, statistics.tiles.len(), reason)
            }
        };
        Row { effect: Effect::Parallax, decision, tiles, error: 0.0, reason }
    }

    fn rows_of_environment(&self, all: usize, (sky, rises): &(Vec<u8>, String)) -> [Row; 3] {
        let around = self.scene.environment();
        let (decision, tiles, reason) = match around {
            Some(_) => (Decision::On, all, "light from all directions"),
            None => (Decision::Absent, 0, "no environment"),
        };
        let reason = reason.to_owned();
        let environment = Row { effect: Effect::Environment, decision, tiles, error: 0.0, reason };
        let hidden = around.is_some() && self.options.over.shadows;
        let bounces = hidden && around.is_some_and(|one| one.albedo > 0.0);
        let of_sky = |effect, bit: u8, there: bool| {
            let tiles = sky.iter().filter(|&&needs| needs & bit != 0).count();
            let decision = match (there, tiles) {
                (false, _) => Decision::Absent,
                (true, 0) => Decision::NoOp,
                _ => Decision::On,
            };
            Row { effect, decision, tiles, error: 0.0, reason: rises.clone() }
        };
        [
            environment,
            of_sky(Effect::SkyOcclusion, SKY, hidden),
            of_sky(Effect::OneBounce, BOUNCE, bounces),
        ]
    }
}
