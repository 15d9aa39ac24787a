//! Golden traces: a hash of x over all iterations, by job. `cargo bench --bench traces -- STUDY N` solves every Nth job.

use std::path::Path;

use sinew::internals::deadline::Deadline;
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::sqp;
use sinew::internals::prepare::{Prepared, Task};
use sinew::internals::starts::disturb;
use sinew::internals::study::Study;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    for pair in arguments.chunks(2) {
        let study = Study::load(Path::new(&pair[0])).unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)));
        for job in study.jobs.iter().step_by(pair[1].parse().unwrap()) {
            let (settings, points) = (&job.settings, job.points);
            let Ok(model) = study.model_of(job) else { continue };
            let task = Task { model: &model, motion: &study.motion, settings, points };
            let Ok(prepared) = Prepared::new(task, Deadline::default()) else { continue };
            let problem = prepared.transcribe();
            let guess = prepared.guess(Deadline::default()).unwrap();
            let guess = disturb(&guess, problem.scheme, &prepared.inverse, settings.seed, settings.first_start);
            let outcome = sqp::solve(&problem, guess, SqpOptions::default());
            let mut hash = 0xcbf2_9ce4_8422_2325u64;
            for x in outcome.trace.iter().flat_map(|record| &record.x) {
                hash = (hash ^ x.to_bits()).wrapping_mul(0x100_0000_01b3);
            }
            if std::env::var_os("VERBOSE").is_some() {
                for (k, r) in outcome.trace.iter().enumerate() {
                    println!(
                        "{k:3} f {:12.6e} stat {:.1e} feas {:.1e} comp {:.1e} step {:.1e} δ {:.0e} α {:.3} {} ref {} leap {} ext {} {} fact {}",
                        r.objective,
                        r.error.stationarity,
                        r.error.feasibility,
                        r.error.complementarity,
                        r.step_norm,
                        r.damping.unwrap_or(0.0),
                        r.fraction.unwrap_or(0.0),
                        r.way.map_or("-", |w| w.name()),
                        r.refusals,
                        r.leap,
                        r.extension,
                        if r.is_restored { "restored" } else { "" },
                        r.factorisations
                    );
                }
            }
            println!(
                "{} {} {:?} {} {} {hash:016x}",
                study.name,
                job.index,
                outcome.status,
                outcome.iterations(),
                outcome.factorisations
            );
        }
    }
}
