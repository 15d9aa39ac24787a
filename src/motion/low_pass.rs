//! Smoothing of measured values over time.

use crate::numerics::cubic::{CubicSpline, Ends};

/// A natural spline through `values` at `time` (s) after [`low_pass`].
pub fn smooth_spline(time: &[f64], values: &[f64], cutoff_hz: f64) -> CubicSpline {
    let smooth = low_pass(time, values, cutoff_hz);
    CubicSpline::new(&time.iter().copied().zip(smooth).collect::<Vec<_>>(), Ends::Natural)
}

/// The highest cut-off frequency of [`low_pass`], as a fraction of the sampling rate.
pub const HIGHEST_CUTOFF: f64 = 0.38;

/// Zero-lag second-order Butterworth low-pass: resamples `values` uniformly, extends them at both ends by point
/// reflection about the end values, filters forwards and backwards, and returns the result at `time` (s). Returns
/// `values` unchanged if `cutoff_hz` is 0.
///
/// Source: D. A. Winter, *Biomechanics and Motor Control of Human Movement*, Wiley, ch. 3 (the standard filter for
/// kinematic data).
pub fn low_pass(time: &[f64], values: &[f64], cutoff_hz: f64) -> Vec<f64> {
    let n = time.len();
    if cutoff_hz <= 0.0 {
        return values.to_vec();
    }
    let points: Vec<(f64, f64)> = time.iter().copied().zip(values.iter().copied()).collect();
    let spline = CubicSpline::new(&points, Ends::Natural);
    let step = (time[n - 1] - time[0]) / (n - 1) as f64;
    let uniform: Vec<f64> = (0..n).map(|i| spline.at(time[0] + i as f64 * step)[0]).collect();
    // Two second-order passes lower the −3 dB frequency by the factor (√2 − 1)^¼.
    let warped = (std::f64::consts::PI * cutoff_hz * step / (2f64.sqrt() - 1.0).powf(0.25)).min(1.5).tan();
    let (k, k2) = (2f64.sqrt() * warped, warped * warped);
    let b = k2 / (1.0 + k + k2);
    let (a1, a2) = (2.0 * (k2 - 1.0) / (1.0 + k + k2), (1.0 - k + k2) / (1.0 + k + k2));
    let pad = n - 1;
    let mirrored: Vec<f64> = (0..n + 2 * pad)
        .map(|i| match i {
            _ if i < pad => 2.0 * uniform[0] - uniform[pad - i],
            _ if i >= n + pad => 2.0 * uniform[n - 1] - uniform[2 * n + pad - 2 - i],
            _ => uniform[i - pad],
        })
        .collect();
    let pass = |x: &[f64]| -> Vec<f64> {
        let mut y = vec![x[0]; x.len()];
        for i in 2..x.len() {
            y[i] = b * (x[i] + 2.0 * x[i - 1] + x[i - 2]) - a1 * y[i - 1] - a2 * y[i - 2];
        }
        y.reverse();
        y
    };
    let filtered = pass(&pass(&mirrored));
    let smooth: Vec<(f64, f64)> = (0..n).map(|i| (time[0] + i as f64 * step, filtered[pad + i])).collect();
    let smooth = CubicSpline::new(&smooth, Ends::Natural);
    time.iter().map(|&t| smooth.at(t)[0]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_keeps_lines_passes_low_and_stops_high_frequencies() {
        let time: Vec<f64> = (0..=200).map(|i| i as f64 * 0.01).collect();
        let line: Vec<f64> = time.iter().map(|t| 2.0 * t - 1.0).collect();
        let smooth = low_pass(&time, &line, 6.0);
        assert!(line.iter().zip(&smooth).all(|(a, b)| (a - b).abs() < 1e-3));
        let gain = |hz: f64| {
            let wave: Vec<f64> = time.iter().map(|t| (std::f64::consts::TAU * hz * t).sin()).collect();
            let out = low_pass(&time, &wave, 6.0);
            let energy = |x: &[f64]| x[40..160].iter().map(|v| v * v).sum::<f64>();
            (energy(&out) / energy(&wave)).sqrt()
        };
        assert!(gain(1.0) > 0.98 && gain(20.0) < 0.02);
        assert!((gain(6.0) - 0.5f64.sqrt()).abs() < 0.03, "{}", gain(6.0));
    }
}
