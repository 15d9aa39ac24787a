//! Roots of increasing functions.

/// Newton's steps and bisections at most.
const MAX_STEPS: usize = 60;

/// Where an increasing function is zero, from `start` within a bracket: Newton's method, with bisection where a step leaves the
/// bracket. `at`: the function with its slope. Ends where the function is within `tolerance` of zero, or the bracket not longer
/// than `width`.
pub fn increasing_root(
    [mut low, mut high]: [f64; 2],
    start: f64,
    [tolerance, width]: [f64; 2],
    at: impl Fn(f64) -> [f64; 2],
) -> f64 {
    let mut x = start;
    for _ in 0..MAX_STEPS {
        let [value, slope] = at(x);
        if value.abs() <= tolerance || high - low <= width {
            break;
        }
        *if value > 0.0 { &mut high } else { &mut low } = x;
        let next = x - value / slope;
        x = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_are_found_where_newtons_method_alone_goes_astray() {
        let found = increasing_root([-50.0, 80.0], 40.0, [1e-14, 0.0], |x: f64| [x.atan() - 0.5, 1.0 / (1.0 + x * x)]);
        assert!((found - 0.5f64.tan()).abs() < 1e-13);
        // A function that jumps has no value near zero: the bracket ends it.
        let jump = increasing_root([0.0, 1.0], 0.9, [0.0, 1e-12], |x| [if x < 0.3 { -1.0 } else { 1.0 }, 0.0]);
        assert!((jump - 0.3).abs() < 1e-11);
    }
}
