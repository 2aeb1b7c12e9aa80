//! Reflection models against evaluations of their published formulas in 50 digits.

use core::f64::consts::PI;

use impasto::brdf::lafortune::{Lobe, Pair, Sharp, turn_and_log_length};
use impasto::math::{Scalar, Vec3};

/// A published fit and its values for each pair of directions.
struct Fit {
    name: &'static str,
    diffuse: f64,
    specular: f64,
    cxy: f64,
    cz: f64,
    exponent: f64,
    values: Vec<f64>,
}

/// `tests/oracles/lafortune.py` wrote the file.
fn table() -> (Vec<[Vec3<f64>; 3]>, Vec<Fit>) {
    let (mut pairs, mut fits) = (Vec::new(), Vec::new());
    for line in include_str!("lafortune.txt").lines() {
        let mut words = line.split(' ');
        let kind = words.next();
        let name = if kind == Some("fit") { words.next().expect("a name") } else { "" };
        let numbers: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
        match kind {
            Some("pair") => {
                let vector = |i: usize| Vec3::new(numbers[i], numbers[i + 1], numbers[i + 2]);
                pairs.push([vector(0), vector(3), vector(6)]);
            }
            Some("fit") => fits.push(Fit {
                name,
                diffuse: numbers[0],
                specular: numbers[1],
                cxy: numbers[2],
                cz: numbers[3],
                exponent: numbers[4],
                values: numbers[5..].to_vec(),
            }),
            _ => {}
        }
    }
    (pairs, fits)
}

fn cast<S: Scalar>(v: Vec3<f64>) -> Vec3<S> {
    Vec3::new(S::from_f64(v.x), S::from_f64(v.y), S::from_f64(v.z))
}

/// The largest relative error over all fits and pairs, and where.
fn worst<S: Scalar>(smallest: f64) -> (f64, String) {
    let (pairs, fits) = table();
    assert_eq!((pairs.len(), fits.len()), (14, 86));
    let mut worst = (0.0, String::new());
    for fit in &fits {
        let Fit { specular, cxy, cz, exponent, .. } = *fit;
        let peak = specular * (exponent + 2.0) / (2.0 * PI);
        // The table's lobes are divided by max(|cz|, |cxy|)^n.
        let log = exponent.mul_add(-cxy.abs().max(cz.abs()).ln(), peak.ln());
        let lobe = Sharp::<S>::new(log, cxy, cz, exponent);
        for (i, ([n, l, v], &expected)) in pairs.iter().zip(&fit.values).enumerate() {
            let value = lobe.value(cast(*n), cast(*l), cast(*v)) + S::from_f64(fit.diffuse / PI);
            assert!(value.to_f64().is_finite(), "{} {i}", fit.name);
            let error = (value.to_f64() - expected).abs();
            if expected < smallest {
                // Below the smallest exponential a lobe is dark.
                assert!(error <= smallest);
            } else if error > worst.0 * expected {
                worst = (error / expected, format!("{} {i}: {expected}", fit.name));
            }
        }
    }
    worst
}

#[test]
fn hard_case_11_exponents_to_16_600() {
    let (error, at) = worst::<f32>(1e-36);
    // exp itself is within 2e-7, the sum and the rounded result add 6e-8 each.
    assert!(error < 4e-7, "{error:e} {at}");
}

#[test]
fn published_lobes_hold_in_double_precision() {
    let (error, at) = worst::<f64>(1e-300);
    // The table's decimals are rounded to doubles: cxy and cz by 1.1e-16, which n multiplies.
    assert!(error < 2.0 * 1.1e-16 * 16_600.0, "{error:e} {at}");
}

#[test]
fn hard_case_12_sharp_lobe_near_its_peak() {
    for exponent in [50.0, 500.0, 5000.0, 16_600.0_f64] {
        let lobe = Sharp::<f32>::new(0.0, -1.0, 1.0, exponent);
        let mut worst: f64 = 0.0;
        for i in 0..2000 {
            let t = f64::from(i);
            let view = Vec3::new(0.3 * (0.7 * t).sin(), 0.4 * (1.1 * t).cos(), 1.0).normalised();
            let normal = Vec3::new(0.2 * (0.3 * t).cos(), 0.2 * (0.9 * t).sin(), 1.0).normalised();
            // The mirror direction, and off it by up to five widths of 1 / sqrt n.
            let mirror = normal.scale(2.0 * normal.dot(view)) - view;
            let off = mirror.cross(Vec3::new((2.1 * t).sin(), (2.1 * t).cos(), 0.3)).normalised();
            let light = (mirror + off.scale(t / 2000.0 * 5.0 / exponent.sqrt())).normalised();
            let [n, l, v] = [normal, light, view].map(cast::<f32>);
            // What directions as rounded as they are give in double precision, whose own error is
            // n 2e-16 = 4e-12. Lengths are off 1 by roundings: the base says so, too.
            let [exact_n, exact_l, exact_v] =
                [n, l, v].map(|u| Vec3::new(f64::from(u.x), f64::from(u.y), f64::from(u.z)));
            let upright = exact_n.dot(exact_l) * exact_n.dot(exact_v);
            let base = 2.0 * upright - exact_l.dot(exact_v);
            let expected = (exponent * base.ln()).exp();
            worst = worst.max((f64::from(lobe.value(n, l, v)) / expected - 1.0).abs());
        }
        // Below 1e-6, where one rounding of d alone would cost 6e-8 n: 1e-3.
        assert!(worst < 1e-6, "{exponent}: {worst:e}");
    }
}

/// The form that fits use, in single precision, from rounded products.
#[test]
fn hard_case_12_the_fast_form_loses_what_rounding_of_d_costs() {
    let (pairs, fits) = table();
    for fit in &fits {
        let Fit { specular, cxy, cz, exponent, .. } = *fit;
        let [turn, length] = turn_and_log_length(cxy, cz);
        let longest = cxy.abs().max(cz.abs()).ln();
        let amplitude =
            specular * (exponent + 2.0) / (2.0 * PI) * (exponent * (length - longest)).exp();
        let lobe = Lobe::new(amplitude as f32, turn as f32, exponent.ln() as f32);
        for ([n, l, v], &expected) in pairs.iter().zip(&fit.values) {
            let (n, l, v) = (cast::<f32>(*n), cast(*l), cast(*v));
            let value = lobe.value(&Pair::against(n, l, v, l.dot(v))) + (fit.diffuse / PI) as f32;
            assert!(value.is_finite(), "{}", fit.name);
            // Six roundings of d, one of ln n (which n ln d multiplies by ln n), one of the turn:
            // each 6e-8, times n, as far as the lobe (below expected) has any weight.
            let error = (f64::from(value) - expected).abs() / expected.max(1e-30);
            assert!(error < 1e-6 + 8.0 * 6e-8 * exponent, "{} {error}", fit.name);
        }
    }
}
