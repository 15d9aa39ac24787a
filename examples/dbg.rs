use sinew::study::Study;
use sinew::guess::start_guess;
use sinew::motion::MotionSettings;
use sinew::nlp::sqp::{self, SqpSettings};
use sinew::solve::{discretise, transcribe};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let study = Study::load(std::path::Path::new(&args[1])).unwrap();
    let job = &study.jobs[args[2].parse::<usize>().unwrap()];
    let model = study.model_of(job).unwrap();
    let s = &job.settings;
    let ms = MotionSettings { measurement_ratio: s.measured_per_interval(), smoothing_hz: s.smoothing_hz, noise_sd: s.noise_sd, seed: s.seed, time_scale: s.time_scale, changes: s.motion.clone() };
    let meas = ms.measure(&study.motion, &model, job.points).unwrap();
    let (instant, scheme) = discretise(&model, s, job.points, study.motion.duration() * s.time_scale);
    let problem = transcribe(&instant, scheme.as_ref(), &meas, s);
    let guess = start_guess(&model, scheme.as_ref(), job.points, &meas).unwrap();
    let out = sqp::solve(&problem, guess, SqpSettings::default());
    println!("{:?} {} fact {}", out.status, out.iterations(), out.factorisations);
    let show: Vec<usize> = args[3..].iter().map(|a| a.parse().unwrap()).collect();
    for k in show {
        println!("--- iteration {k} {:?}", out.trace[k].error);
        for m in 0..model.muscles.len() {
            let v: Vec<String> = (0..problem.layout.points.len()).map(|j| { let z = problem.local(j, &out.trace[k].x); let at = instant.muscle(m); format!("{:9.4}/{:8.2e}/{:7.1e}", z[at+2], z[at], z[at+4]) }).collect();
            println!("{:18} {}", model.muscles[m].name, v.join(" "));
        }
    }
}
