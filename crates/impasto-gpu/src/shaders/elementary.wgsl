// Elementary functions as the CPU computes them (math/elementary.rs): the built-in ones are not
// accurate enough on every device.

// exp(x) for -87 <= x <= 87: Cody-Waite reduction and a polynomial.
fn exp_in_range(x: f32) -> f32 {
    let k = round(x * 1.4426950408889634);
    // ln 2 in two parts: k times the upper part is exact.
    var r = fma(k, -0.693359375, x);
    r = fma(k, 2.1219444005469058e-4, r);
    var tail = 1.98756915e-4;
    tail = fma(tail, r, 1.39819995e-3);
    tail = fma(tail, r, 8.3334519e-3);
    tail = fma(tail, r, 4.1665796e-2);
    tail = fma(tail, r, 1.66666655e-1);
    tail = fma(tail, r, 5.00000012e-1);
    let value = fma(tail, r * r, r) + 1.0;
    return value * bitcast<f32>(u32(i32(k) + 127) << 23u);
}

// exp(x), flushed to zero below -87.
fn exponential(x: f32) -> f32 {
    let value = exp_in_range(clamp(x, -87.0, 87.0));
    return select(value, 0.0, x < -87.0);
}

// Natural logarithm of a positive normal number.
fn ln_in_range(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    // The exponent counted from the root of 1/2.
    let exponent = bitcast<i32>(bits - 0x3f3504f3u) >> 23u;
    let e = f32(exponent);
    let f = bitcast<f32>(bits - (bitcast<u32>(exponent) << 23u)) - 1.0;
    let square = f * f;
    // ln 2 in two parts: e times the upper part is exact.
    let low = e * -2.1219444005469058e-4;
    var tail = 7.0376836292e-2;
    tail = fma(tail, f, -1.1514610310e-1);
    tail = fma(tail, f, 1.1676998740e-1);
    tail = fma(tail, f, -1.2420140846e-1);
    tail = fma(tail, f, 1.4249322787e-1);
    tail = fma(tail, f, -1.6668057665e-1);
    tail = fma(tail, f, 2.0000714765e-1);
    tail = fma(tail, f, -2.4999993993e-1);
    tail = fma(tail, f, 3.3333331174e-1);
    tail = fma(tail * f, square, low);
    return fma(e, 0.693359375, fma(square, -0.5, tail) + f);
}

// phi^2 from e = |n - h|^2 / 2 = 1 - cos(phi): nothing is lost near 0, as acos would.
fn phi_squared(e: f32) -> f32 {
    var sum = 6.2160062160e-4;
    sum = fma(sum, e, 1.5222872361e-3);
    sum = fma(sum, e, 3.8480038480e-3);
    sum = fma(sum, e, 1.0158730159e-2);
    sum = fma(sum, e, 2.8571428571e-2);
    sum = fma(sum, e, 8.8888888889e-2);
    sum = fma(sum, e, 3.3333333333e-1);
    sum = fma(sum, e, 2.0);
    return sum * e;
}
