//! Weights of pixels where photographs are held out.

/// Weights of pixels: bounded influence [@krasker1982bounded], as Mallows weighs.
///
/// A few pixels whose lobe the fitted photographs hardly determine would follow the rig without
/// bound, and the rig hardly move.
pub(super) fn bounded(leverage: &[Option<Vec<f64>>]) -> Vec<f64> {
    let known: Vec<&Vec<f64>> = leverage.iter().flatten().collect();
    let usual: Vec<f64> = (0..known.first().map_or(0, |first| first.len()))
        .map(|number| median(known.iter().map(|of| of[number]).collect()))
        .collect();
    let weight = |of: &Vec<f64>| {
        let times = of.iter().zip(&usual).filter(|(_, usual)| **usual > 0.0);
        times.map(|(of, usual)| of / usual).fold(1.0, f64::max).recip()
    };
    leverage.iter().map(|of| of.as_ref().map_or(1.0, weight)).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let (low, high) = ((values.len() - 1) / 2, values.len() / 2);
    0.5 * (values[low] + values[high])
}
