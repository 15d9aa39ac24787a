use super::active_set::{self, NoStep, Step};
use super::filter::{Filter, Verdict};
use super::iterate::{Iterate, KktError};
use super::kkt::{Kkt, KktValues};
use super::problem::Problem;
use super::qp::{QpFailure, QuadraticProgramme};
use crate::numerics::sparse::Sparse;

#[derive(Clone, Debug)]
pub struct SqpSettings {
    pub tolerance: f64,
    pub max_iterations: usize,
    pub verbose: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SqpStatus { Converged, IterationLimit, QpFailed, Stalled, Infeasible, NonFinite }

pub struct SqpOutcome {
    pub status: SqpStatus,
    pub iterate: Iterate,
    pub iterations: usize,
    pub qp_calls: usize,
    pub factorisations: usize,
}

fn convex(problem: &dyn Problem, here: &Iterate, hessian: &Sparse, damping: f64, metric: &Sparse) -> Result<Step, QpFailure> {
    let mut p = hessian.clone();
    for (h, m) in p.values.iter_mut().zip(&metric.values) { *h += damping * m; }
    let gram = problem.residual_jacobian();
    let _ = gram;
    let s = QuadraticProgramme { hessian: &p, gradient: &here.gradient, equalities: &here.equality_jacobian, equality_values: &here.equalities,
        inequalities: &here.inequality_jacobian, inequality_values: &here.inequalities }.solve()?;
    let mut slack = here.inequalities.clone();
    here.inequality_jacobian.add_product(1.0, &s.step, &mut slack);
    let active = slack.iter().zip(&s.inequalities).map(|(s, nu)| s < nu).collect();
    Ok(Step { direction: s.step, equality_multipliers: s.equalities, inequality_multipliers: s.inequalities, active, qp_iterations: s.iterations, factorisations: 0 })
}

pub fn solve(problem: &dyn Problem, start: Vec<f64>, settings: &SqpSettings) -> SqpOutcome {
    let [pe, pi, ph] = problem.patterns();
    let mut kkt = Kkt::new(ph, pe, pi, problem.stages());
    let mut hessian = ph.clone();
    let mut metric = ph.clone();
    // Gauss-Newton base
    let mut gauss_newton = ph.clone();
    problem.hessian(&start, super::problem::Multipliers { equalities: &vec![0.0; problem.equalities()], inequalities: &vec![0.0; problem.inequalities()] }, &mut gauss_newton);
    let mut here = Iterate::new(problem, start);
    let mut filter = Filter::new(here.violation());
    let mut active: Option<Vec<bool>> = None;
    let (mut qp_calls, mut factorisations) = (0, 0);
    let mut damping = 1e-2f64;
    let mut leapt = false;
    for iteration in 0..settings.max_iterations {
        let error = here.kkt_error();
        if !here.is_finite() { return SqpOutcome { status: SqpStatus::NonFinite, iterate: here, iterations: iteration, qp_calls, factorisations } }
        if iteration > 0 && error.largest() <= settings.tolerance {
            return SqpOutcome { status: SqpStatus::Converged, iterate: here, iterations: iteration, qp_calls, factorisations };
        }
        problem.hessian(&here.x, here.multipliers(), &mut hessian);
        problem.metric(&here.x, &mut metric);
        let mut accepted = None;
        let mut log = String::new();
        let mut leap_now = false;
        for attempt in 0..14 {
            // step
            let mut used = damping;
            let mut step = None;
            if let Some(guess) = &active {
                match active_set::solve(&mut kkt, &here, &hessian, &metric, &mut used, guess) {
                    Ok(s) => { factorisations += s.factorisations; log += &format!(" pdas{}", s.factorisations); step = Some(s) }
                    Err(e) => { log += &format!(" {e:?}"); }
                }
            }
            let step = match step { Some(s) => s, None => {
                qp_calls += 1;
                match convex(problem, &here, &gauss_newton, used.max(1e-2).min(10.0), &metric) {
                    Ok(s) => { log += &format!(" qp{}", s.qp_iterations); s },
                    Err(e) => { if settings.verbose { println!("qp failed {e:?}"); } return SqpOutcome { status: SqpStatus::QpFailed, iterate: here, iterations: iteration, qp_calls, factorisations } }
                }
            }};
            let slope: f64 = here.gradient.iter().zip(&step.direction).map(|(g, d)| g * d).sum();
            let h = (here.violation(), here.objective);
            let mut alpha = 1.0;
            let mut found = None;
            while alpha > 0.05 {
                let mut trial = here.clone();
                for (x, d) in trial.x.iter_mut().zip(&step.direction) { *x += alpha * d; }
                trial.evaluate(problem);
                let mut verdict = filter.judge(h, slope, alpha, (trial.violation(), trial.objective));
                if alpha == 1.0 && verdict == Verdict::Rejected && trial.is_finite() {
                    // kkt error acceptance
                    let mut full = trial.clone();
                    full.equality_multipliers = step.equality_multipliers.clone();
                    full.inequality_multipliers = step.inequality_multipliers.clone();
                    full.differentiate(problem);
                    if full.kkt_error().largest() < 0.7 * error.largest() && error.largest() < 1e-2 { verdict = Verdict::Progress; log += " K"; }
                    else {
                        // SOC
                        let mut direction = step.direction.clone();
                        let ok = kkt.factorise(&KktValues { hessian: &hessian, metric: &metric, damping: used, equalities: &here.equality_jacobian, inequalities: &here.inequality_jacobian, active: &step.active }).is_some();
                        factorisations += 1;
                        if ok {
                            let n = here.x.len(); let me = here.equalities.len();
                            let mut last = trial.violation();
                            for _ in 0..4 {
                                let mut right = vec![0.0; kkt.order()];
                                for i in 0..me { right[n + i] = -trial.equalities[i]; }
                                for i in 0..step.active.len() { right[n + me + i] = -trial.inequalities[i]; }
                                let mut sol = vec![0.0; kkt.order()];
                                kkt.solve(&right, &mut sol);
                                for i in 0..n { direction[i] += sol[i]; trial.x[i] = here.x[i] + direction[i]; }
                                trial.evaluate(problem);
                                verdict = filter.judge(h, slope, 1.0, (trial.violation(), trial.objective));
                                if verdict != Verdict::Rejected { log += " S"; break; }
                                if trial.violation() > 0.5 * last { break; }
                                last = trial.violation();
                            }
                        }
                    }
                }
                if verdict != Verdict::Rejected { found = Some((alpha, trial, verdict)); break; }
                alpha *= 0.5;
            }
            match found {
                Some((alpha, mut trial, verdict)) => {
                    if alpha == 1.0 && step.factorisations == 1 && used <= 1e-5 && error.largest() < 1e-1 && !leapt {
                        let mut m = 4.0;
                        while m < 300.0 {
                            let mut far = trial.clone();
                            let mut direction: Vec<f64> = step.direction.iter().map(|d| m * d).collect();
                            let n = here.x.len(); let me = here.equalities.len();
                            for i in 0..n { far.x[i] = here.x[i] + direction[i]; }
                            far.evaluate(problem);
                            for _ in 0..2 {
                                let mut right = vec![0.0; kkt.order()];
                                for i in 0..me { right[n + i] = -far.equalities[i]; }
                                for i in 0..step.active.len() { right[n + me + i] = -far.inequalities[i]; }
                                let mut sol = vec![0.0; kkt.order()];
                                kkt.solve(&right, &mut sol);
                                for i in 0..n { direction[i] += sol[i]; far.x[i] = here.x[i] + direction[i]; }
                                far.evaluate(problem);
                            }
                            if far.is_finite() && far.objective < trial.objective - 1e-14 * h.1.abs() && far.violation() <= trial.violation() { trial = far; log += " X"; leap_now = true; m *= 4.0; } else { break; }
                        }
                    }
                    if verdict == Verdict::Progress { filter.add(h); }
                    damping = if alpha >= 1.0 && attempt == 0 { if used > damping { used / 3.0 } else { damping / 5.0 } } else { used };
                    if damping < 1e-13 { damping = 1e-13 }
                    accepted = Some((alpha, trial, step));
                    break;
                }
                None => { damping = (used * 20.0).max(1e-10); }
            }
        }
        if settings.verbose {
            let nact = active.as_ref().map_or(0, |a| a.iter().filter(|x| **x).count());
            println!("{iteration:3} f {:.8} theta {:.2e} stat {:.1e} feas {:.1e} comp {:.1e} act {nact} damp {damping:.1e} alpha {:?} {log} {}", here.objective, here.violation(), error.stationarity, error.feasibility, error.complementarity, accepted.as_ref().map(|a| a.0), accepted.as_ref().map_or(String::new(), |a| { let (i, d) = a.2.direction.iter().enumerate().max_by(|x, y| x.1.abs().total_cmp(&y.1.abs())).unwrap(); format!("x{i} {d:.1e}") }));
        }
        let Some((alpha, mut trial, step)) = accepted else {
            return SqpOutcome { status: SqpStatus::Stalled, iterate: here, iterations: iteration, qp_calls, factorisations };
        };
        for (l, s) in trial.equality_multipliers.iter_mut().zip(&step.equality_multipliers) { *l += alpha.min(1.0) * (s - *l); }
        for (l, s) in trial.inequality_multipliers.iter_mut().zip(&step.inequality_multipliers) { *l += alpha.min(1.0) * (s - *l); }
        trial.differentiate(problem);
        here = trial;
        active = Some(step.active);
        leapt = leap_now;
    }
    SqpOutcome { status: SqpStatus::IterationLimit, iterate: here, iterations: settings.max_iterations, qp_calls, factorisations }
}
