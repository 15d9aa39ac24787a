//! Seeded samples: each draws a value of every parameter from a range or a list.

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::axis::{Expansion, KeyPath, Range, SAMPLE, at, check_name, issue, values};
use super::file::{Method, Sample};
use crate::error::Issue;
use crate::settings::Value;

/// Largest numbers of samples and of parameters in a Sobol' sequence, set by the tables of the library.
const SOBOL_LIMITS: (usize, usize) = (1 << 16, 256);

/// The samples of a sweep, numbered in the column `sample`.
///
/// # Errors
/// An [`Issue`] with the place of the faulty parameter.
pub fn samples(sample: &Sample, place: &[String]) -> Result<Expansion, Issue> {
    let count = sample.count;
    if !(1..=1_000_000).contains(&count) {
        let help = "`count` is a whole number from 1 to 1000000";
        return Err(issue(at(place, &["count"]), format!("found {count}"), help));
    }
    let mut draws = Vec::new();
    for (name, spec) in &sample.draws {
        let place = at(place, &[name]);
        draws.push((std::sync::Arc::<str>::from(name.as_str()), Draw::new(name, spec, &place)?, place));
    }
    if draws.is_empty() {
        let help = "add a parameter such as mu = { from = 0.1, to = 1.0 }";
        return Err(issue(place.to_vec(), "no parameter is sampled", help));
    }
    let names: Vec<&str> = sample.draws.keys().map(String::as_str).collect();
    let shares = shares(sample, &names, place)?;
    let numbers: std::sync::Arc<str> = SAMPLE.into();
    let point = |i: usize| {
        let drawn = draws.iter().zip(&shares).map(|((name, draw, _), shares)| (name.clone(), draw.at(shares[i])));
        std::iter::once((numbers.clone(), Value::Integer(i as i64))).chain(drawn).collect()
    };
    let points = (0..count).map(point).collect();
    let axes = std::iter::once((numbers.clone(), place.to_vec()));
    Ok(Expansion {
        points,
        axes: axes.chain(draws.iter().map(|(name, _, place)| (name.clone(), place.clone()))).collect(),
    })
}

/// For each parameter, `count` numbers in [0, 1). They follow from the names and the seed; the order in the file does
/// not matter.
fn shares(sample: &Sample, names: &[&str], place: &[String]) -> Result<Vec<Vec<f64>>, Issue> {
    let (count, dimensions) = (sample.count, names.len());
    let mut shares = vec![vec![0.0; count]; dimensions];
    match sample.method {
        Method::Random => {
            for (dimension, name) in shares.iter_mut().zip(names) {
                let mut rng = stream(sample.seed, name);
                dimension.iter_mut().for_each(|share| *share = rng.random());
            }
        }
        Method::LatinHypercube => {
            for (dimension, name) in shares.iter_mut().zip(names) {
                let mut rng = stream(sample.seed, name);
                for (i, share) in dimension.iter_mut().enumerate() {
                    *share = (i as f64 + rng.random::<f64>()) / count as f64;
                }
                dimension.shuffle(&mut rng);
            }
        }
        Method::Sobol => {
            if count > SOBOL_LIMITS.0 || dimensions > SOBOL_LIMITS.1 {
                let message = format!("{count} samples of {dimensions} parameters");
                let help = format!(
                    "Sobol' points are limited to {} samples of {} parameters; latin_hypercube has no such limit",
                    SOBOL_LIMITS.0, SOBOL_LIMITS.1
                );
                return Err(issue(at(place, &["method"]), message, help));
            }
            let seed = (sample.seed ^ (sample.seed >> 32)) as u32;
            // The dimensions of one sequence belong together. Parameters get them in alphabetical order.
            let mut order: Vec<usize> = (0..dimensions).collect();
            order.sort_by_key(|&d| names[d]);
            for (dimension, d) in order.into_iter().enumerate() {
                for (i, share) in shares[d].iter_mut().enumerate() {
                    *share = f64::from(sobol_burley::sample(i as u32, dimension as u32, seed));
                }
            }
        }
    }
    Ok(shares)
}

/// The random numbers of one parameter.
fn stream(seed: u64, name: &str) -> ChaCha8Rng {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&seed.to_le_bytes()).update(name.as_bytes());
    ChaCha8Rng::from_seed(*hasher.finalize().as_bytes())
}

/// What a sampled parameter is drawn from.
enum Draw {
    Range(Range),
    Choice(Vec<Value>),
}

impl Draw {
    fn new(name: &str, spec: &toml::Value, place: &KeyPath) -> Result<Self, Issue> {
        check_name(name, spec, place)?;
        match spec {
            toml::Value::Array(_) => Ok(Draw::Choice(values(name, spec, place)?)),
            toml::Value::Table(range) if range.keys().all(|k| ["from", "to", "scale"].contains(&k.as_str())) => {
                Ok(Draw::Range(Range::new(range, place)?))
            }
            _ => Err(issue(
                place.clone(),
                "nothing to draw from",
                "a sampled parameter is a range { from = …, to = … } (optionally scale = \"log\") or a list of values",
            )),
        }
    }

    /// The value at a fraction from 0 to 1.
    fn at(&self, share: f64) -> Value {
        match self {
            Draw::Range(range) => Value::Number(range.share(share)),
            Draw::Choice(values) => values[((share * values.len() as f64) as usize).min(values.len() - 1)].clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(method: &str, count: usize, seed: u64) -> Vec<Vec<Value>> {
        let text = format!(
            "method = '{method}'\ncount = {count}\nseed = {seed}\nmu = {{ from = 0.01, to = 1.0, scale = 'log' }}\n\
             b = ['x', 'y']\n'body.a.mass' = {{ from = 1.0, to = 2.0 }}"
        );
        let expansion = samples(&toml::from_str(&text).unwrap(), &[]).unwrap();
        expansion.points.into_iter().map(|point| point.into_iter().map(|(_, value)| value).collect()).collect()
    }

    #[test]
    fn samples_are_seeded_and_spread() {
        for method in ["random", "latin_hypercube", "sobol"] {
            let jobs = drawn(method, 64, 4);
            assert_eq!(jobs, drawn(method, 64, 4), "{method}");
            assert_ne!(jobs, drawn(method, 64, 5), "{method}");
            assert!(jobs.iter().all(|j| (1.0..2.0).contains(&j[3].number().unwrap())));
            let small = jobs.iter().filter(|j| j[1].number().unwrap() < 0.1).count();
            let x = jobs.iter().filter(|j| j[2] == Value::Text("x".into())).count();
            let even = if method == "random" { 20..44 } else { 32..33 };
            assert!(even.contains(&small) && even.contains(&x), "{method}: {small} {x}");
        }
    }

    #[test]
    fn the_order_of_the_keys_does_not_matter() {
        for method in ["random", "latin_hypercube", "sobol"] {
            let head = format!("method = '{method}'\ncount = 20\nseed = 3\n");
            let (mu, mass) = ("mu = { from = 0.0, to = 1.0 }\n", "'body.a.mass' = { from = 1.0, to = 2.0 }\n");
            let values = |text: String| {
                let points = samples(&toml::from_str(&text).unwrap(), &[]).unwrap().points;
                points
                    .into_iter()
                    .map(|mut p| {
                        p.sort_by(|a, b| a.0.cmp(&b.0));
                        p
                    })
                    .collect::<Vec<_>>()
            };
            assert_eq!(values(format!("{head}{mu}{mass}")), values(format!("{head}{mass}{mu}")), "{method}");
        }
    }

    #[test]
    fn each_part_of_a_range_is_met_once() {
        for method in ["latin_hypercube", "sobol"] {
            let jobs = drawn(method, 64, 9);
            let mut parts: Vec<usize> = jobs.iter().map(|j| ((j[3].number().unwrap() - 1.0) * 64.0) as usize).collect();
            parts.sort_unstable();
            assert_eq!(parts, (0..64).collect::<Vec<_>>(), "{method}");
        }
    }
}
