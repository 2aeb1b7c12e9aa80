//! Interval arithmetic.

/// A smallest and a largest value.
pub(super) type Interval = [f64; 2];

pub(super) fn plus([a, b]: Interval, [c, d]: Interval) -> Interval {
    [a + c, b + d]
}

/// 0 times anything is 0: black reflects nothing of what has no bound. NaN says that nothing is known.
pub(super) fn times([a, b]: Interval, [c, d]: Interval) -> Interval {
    let product = |one: f64, other: f64| {
        if (one == 0.0 && !other.is_nan()) || (other == 0.0 && !one.is_nan()) {
            0.0
        } else {
            one * other
        }
    };
    let ends = [product(a, c), product(a, d), product(b, c), product(b, d)];
    // `min` and `max` would lose it.
    if ends.iter().any(|end| end.is_nan()) {
        return [f64::NAN; 2];
    }
    [
        ends.into_iter().fold(f64::INFINITY, f64::min),
        ends.into_iter().fold(-f64::INFINITY, f64::max),
    ]
}

/// Everything from the smaller to the larger end of both.
pub(super) fn either([a, b]: Interval, [c, d]: Interval) -> Interval {
    if [a, b, c, d].iter().any(|end| end.is_nan()) {
        return [f64::NAN; 2];
    }
    [a.min(c), b.max(d)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_holds_every_product_of_its_factors() {
        let intervals = [[-2.0, -1.0], [-1.0, 3.0], [0.0, 0.0], [0.0, 2.0], [0.5, 4.0]];
        for one in intervals {
            for other in intervals {
                let [low, high] = times(one, other);
                for i in 0..=10 {
                    for j in 0..=10 {
                        let at = |[low, high]: Interval, i: i32| {
                            low + (high - low) * f64::from(i) / 10.0
                        };
                        let product = at(one, i) * at(other, j);
                        assert!(low <= product && product <= high, "{one:?} {other:?}");
                    }
                }
                // It is no wider than two of them.
                let ends = one.map(|a| other.map(|b| a * b)).concat();
                assert!(ends.contains(&low) && ends.contains(&high));
            }
        }
        assert_eq!(times([0.0, 1.0], [1.0, f64::INFINITY]), [0.0, f64::INFINITY]);
        assert_eq!(times([0.0, 0.0], [0.0, f64::INFINITY]), [0.0, 0.0]);
        assert!(times([0.0, 1.0], [f64::NAN, 1.0])[1].is_nan());
        assert_eq!(either([1.0, 2.0], [0.0; 2]), [0.0, 2.0]);
        assert!(either([f64::NAN; 2], [0.0; 2])[0].is_nan());
    }
}
