//! Against certified values and the numbers' own limits.

use super::*;

/// `b1 (1 - exp(-b2 x))`.
struct Saturation(&'static [(f64, f64)]);

impl Problem<f64, 2> for Saturation {
    fn normal(&self, [a, b]: [f64; 2]) -> Normal<f64, 2> {
        let mut normal = Normal::zero();
        for &(y, x) in self.0 {
            let rest = (-b * x).exp();
            normal.add([1.0 - rest, a * x * rest], y - a * (1.0 - rest));
        }
        normal
    }
}

/// `NIST` `StRD` nonlinear regression, Misra1a (Misra 1978, dental research; lower difficulty).
const MISRA1A: [(f64, f64); 14] = [
    (10.07, 77.6),
    (14.73, 114.9),
    (17.94, 141.1),
    (23.93, 190.8),
    (29.61, 239.9),
    (35.18, 289.0),
    (40.02, 332.8),
    (44.82, 378.4),
    (50.76, 434.8),
    (55.05, 477.3),
    (61.01, 536.8),
    (66.40, 593.1),
    (75.47, 689.1),
    (81.78, 760.0),
];

/// Certified: parameters, their standard deviations, residual sum of squares.
const CERTIFIED: [f64; 5] = [
    2.389_421_291_8e2,
    5.501_564_318_1e-4,
    2.707_007_524_1,
    7.266_868_839_8e-6,
    1.245_513_889_4e-1,
];

#[test]
fn misra1a_reaches_the_certified_values_from_both_starts() {
    for start in [[500.0, 1e-4], [250.0, 5e-4]] {
        let outcome = minimise(&Saturation(&MISRA1A), start, &Bounds::none(), &Options::default());
        assert!(outcome.reason.converged(), "{:?}", outcome.reason);
        let close = |found: f64, certified: f64| (found / certified - 1.0).abs();
        // Relative tests of 1e-12 on the cost leave half as many digits in the parameters.
        assert!(close(outcome.parameters[0], CERTIFIED[0]) < 1e-6);
        assert!(close(outcome.parameters[1], CERTIFIED[1]) < 1e-6);
        assert!(close(outcome.normal.cost, CERTIFIED[4]) < 1e-9);
        // Standard deviations with 14 - 2 degrees of freedom; the Gauss-Newton matrix is NIST's.
        let covariance = outcome.covariance(outcome.normal.cost / 12.0);
        assert!(close(covariance[0][0].sqrt(), CERTIFIED[2]) < 1e-4);
        assert!(close(covariance[1][1].sqrt(), CERTIFIED[3]) < 1e-4);
    }
}

/// `a + b` times x: only the sum is determined.
struct Twins(f64);

impl Problem<f64, 2> for Twins {
    fn normal(&self, [a, b]: [f64; 2]) -> Normal<f64, 2> {
        let mut normal = Normal::zero();
        for x in [1.0, 2.0, 3.0] {
            normal.add([x, x], self.0 * x - (a + b) * x);
        }
        normal
    }
}

#[test]
fn parameters_that_nothing_tells_apart_are_named() {
    let outcome = minimise(&Twins(4.0), [0.0, 0.0], &Bounds::none(), &Options::default());
    // Without noise the next step is what the sum lacks: less than 1e-10 of 4 where the search ends.
    assert!((outcome.parameters[0] + outcome.parameters[1] - 4.0).abs() < 1e-9);
    assert_eq!(outcome.deficient(), [false, true]);
    assert!(outcome.parameters.iter().all(|p| p.is_finite()));
}

/// `a exp(-b x)` through three points, whose values are multiplied by this scale.
struct Decay(f64);

impl Problem<f64, 2> for Decay {
    fn normal(&self, [a, b]: [f64; 2]) -> Normal<f64, 2> {
        let mut normal = Normal::zero();
        for (x, y) in [(0.0, 1.0), (1.0, 3.0), (2.0, 4.0)] {
            let decay = (-b * x).exp();
            normal.add([decay, -x * a * decay], self.0 * y - a * decay);
        }
        normal
    }
}

#[test]
fn hard_case_28_a_power_of_two_changes_no_bit_of_a_shape() {
    let fit =
        |scale: f64| minimise(&Decay(scale), [scale, 0.1], &Bounds::none(), &Options::default());
    let plain = fit(1.0);
    for scale in [2.0_f64.powi(40), 2.0_f64.powi(-40)] {
        let scaled = fit(scale);
        assert_eq!(scaled.parameters[1].to_bits(), plain.parameters[1].to_bits());
        assert_eq!(scaled.parameters[0], plain.parameters[0] * scale);
        assert_eq!((scaled.iterations, scaled.reason), (plain.iterations, plain.reason));
    }
}

#[test]
fn bounds_hold_and_the_other_parameters_still_converge() {
    // Unbounded, the decay is negative (the points rise).
    let bounds = Bounds { lower: [0.0, 0.0], upper: [10.0, 10.0] };
    let outcome = minimise(&Decay(1.0), [1.0, 0.5], &bounds, &Options::default());
    assert_eq!(outcome.parameters[1], 0.0);
    // With b = 0 the model is a constant: the mean of 1, 3, 4.
    // A last step that lowers the cost of 14 / 3 by 1e-12 of it has sqrt(1e-12 * 14 / 9) = 1.2e-6;
    // what is left after it is less.
    assert!((outcome.parameters[0] - 8.0 / 3.0).abs() < 1e-6);
    assert!(outcome.reason.converged());
}

#[test]
fn a_start_without_a_cost_says_so() {
    let outcome = minimise(&Decay(f64::NAN), [1.0, 0.1], &Bounds::none(), &Options::default());
    assert_eq!(outcome.reason, Reason::NotFinite);
    assert_eq!(outcome.parameters, [1.0, 0.1]);
}
