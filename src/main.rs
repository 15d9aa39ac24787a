use sinew::{*, error::SourceFile, model::file::ModelFile, motion::*, transcription::{instant::Instant, midpoint::Midpoint, collocation::*}, nlp::{sqp, problem::Problem}};
use std::path::Path;
fn main() {
    let (_, model) = ModelFile::load(&SourceFile::read(Path::new("data/models/arm.toml")).unwrap()).unwrap();
    let table = MotionTable::load(Path::new("data/motions/arm_curl.csv"), &model).unwrap();
    let verbose = std::env::args().nth(1);
    for p in [6usize, 11] { for grid in ["m", "c"] { for bounds in ["a", "u", "b"] {
        let settings = MotionSettings { measurement_ratio: 2, smoothing_hz: 0.0, noise_sd: 0.0, seed: 0, time_scale: 1.0, changes: vec![] };
        let meas = settings.measure(&table, &model, p).unwrap();
        let instant = Instant::new(&model);
        let scheme = Midpoint::new(&instant, p, table.duration());
        let layout = scheme.layout(&instant);
        let mut rows = vec![]; let mut data = vec![];
        for (t, q) in meas.times.iter().zip(&meas.coordinates) { for i in 0..model.coordinates() { rows.push(scheme.coordinate_at(*t, 0, i)); data.push(q[i]); } }
        let mu = 0.2;
        let times = if grid == "m" { meas.times.clone() } else { scheme.points.clone() };
        for t in times { for m in 0..model.muscles.len() { rows.push(scheme.activation_at(t, m).into_iter().map(|(i, w)| (i, mu * w)).collect()); data.push(0.0); } }
        let kinds: &[BoundKind] = match bounds { "a" => &[BoundKind::Activation], "u" => &[BoundKind::Excitation, BoundKind::Force], _ => &[BoundKind::Activation, BoundKind::Excitation] };
        let t0 = std::time::Instant::now();
        let problem = Collocation::new(instant.clone(), layout, &rows, data, kinds);
        let t1 = t0.elapsed(); let v = verbose.as_deref() == Some(&format!("{p}{grid}{bounds}"));
        let x = guess::start_guess(&instant, &scheme, &meas).unwrap();
        let t2 = t0.elapsed();
        if v { let it = nlp::iterate::Iterate::new(&problem, x.clone()); let e = &it.equalities; println!("init {:?}", &e[..22].iter().map(|v| format!("{v:.0e}")).collect::<Vec<_>>().join(" "));
          for j in 0..p { println!("{j}: {}", e[22+20*j..22+20*j+20].iter().map(|v| format!("{v:.2e}")).collect::<Vec<_>>().join(" ")); let z = problem.local(j, &x);
            println!("   q {:?} acc {:?}", &z[..6], &z[6..12]); for m in 0..5 { println!("   m{m} a l v adot u {:?} f {:.4}", &z[12+5*m..17+5*m], problem.instant.fibre_force(&z, m)); } println!("  fr {:?}", &z[37..]); } }
        let v = verbose.as_deref() == Some(&format!("{p}{grid}{bounds}"));
        let out = sqp::solve(&problem, x, sqp::SqpSettings::default());
        if v { for m in 0..5 { println!("{}", model.muscles[m].name); for j in 0..p { let z = problem.local(j, &out.iterate.x); let at = instant.muscle(m); println!("   a {:10.3e} l {:.4} v {:9.3} u {:10.3e} f {:.5} lam_c {:9.2e}  nu {:?}", z[at], z[at+1], z[at+2], z[at+4], instant.fibre_force(&z, m), out.iterate.equality_multipliers[22+20*j+10+m],
          problem.bounds.iter().zip(&out.iterate.inequality_multipliers).filter(|(b, _)| b.muscle == m && b.point == j).map(|(_, n)| format!("{n:.2e}")).collect::<Vec<_>>()); } } }
        println!("{p} {grid} {bounds} n {} m {} {:?} it {} qp {} fac {} f {:.8} kkt {:?} feas {:.1e}  build {:?} guess {:?} solve {:?}", problem.variables(), problem.equalities(), out.status, out.iterations(), out.trace.iter().filter(|r| r.qp_iterations > 0).count(), out.factorisations, out.iterate.objective, out.iterate.kkt_error(), problem.feasibility(&out.iterate.x), t1, t2 - t1, t0.elapsed() - t2);
    }}}
}
