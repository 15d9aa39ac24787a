//! Settings that are one of a few words.

use crate::names::{choices, defaults};

choices! {
    /// How the continuous problem is transcribed.
    Scheme {
        /// the thesis' B-spline collocation, for Table 1; fibre velocities oscillate
        Midpoint = "midpoint",
        /// Radau IIA collocation of the stabilised index-2 form; recommended
        Radau = "radau",
    }
}

choices! {
    /// How muscle loads are found.
    Method {
        /// the motion and the muscles over time together: the motion tracks the measured one (thesis, Paper B)
        Dynamic = "dynamic",
        /// at each instant alone, the motion is given (eq. 1.6; static optimisation)
        Static = "static",
        /// the muscles over time, the motion is given (physiological inverse approach)
        Prescribed = "prescribed",
    }
}

choices! {
    /// What a muscle is.
    MuscleDynamics {
        /// fibre and elastic tendon with activation dynamics, eqs (3)–(11); with `static` in equilibrium with its tendon,
        /// eqs (18)–(22)
        Full = "full",
        /// the tendon keeps its length; with `static` without activation dynamics
        RigidTendon = "rigid_tendon",
        /// any force from 0 to the maximum isometric force at any time, eq. (1.3)
        Force = "force",
    }
}

choices! {
    /// What the muscles' load sharing minimises; the maximum only with `static`.
    Criterion {
        /// Σ w e^p, p = `effort_power`
        Polynomial = "polynomial",
        /// the largest effort, then the largest of the others, and so on
        MinMax = "min_max",
    }
}

choices! {
    /// The effort e of a muscle (`static`, `prescribed`).
    EffortOf {
        /// its activation, of a `force` muscle its force over the maximum isometric force
        Activation = "activation",
        /// its force over that at full activation (`static`)
        Force = "force",
        /// its excitation (`prescribed`)
        Excitation = "excitation",
    }
}

choices! {
    /// The weight w of a muscle's effort, relative to the mean of all muscles.
    EffortWeight {
        /// all alike
        None = "none",
        /// maximum isometric force times optimal fibre length, as its volume goes
        Volume = "volume",
        /// the maximum isometric force
        MaxForce = "max_force",
    }
}

choices! {
    /// Initial fibre lengths (radau).
    Initial {
        /// the fibres are at rest initially: l̇_m = 0; where the motion is given, their tendons
        Equilibrium = "equilibrium",
        /// the same, and ȧ = 0, so that a = u (`prescribed`)
        Steady = "steady",
        /// the initial lengths are unknowns; ill-posed, because they affect only the first step
        Free = "free",
    }
}

choices! {
    /// Bounds imposed at every collocation point. Without a ≥ 0, f_m ≥ 0 is imposed instead.
    Bounds {
        /// no bounds on a and u
        None = "none",
        /// a ≥ 0
        Activation = "activation",
        /// u ≥ 0
        Excitation = "excitation",
        /// a ≥ 0 and u ≥ 0
        Both = "both",
        /// 0 ≤ a ≤ 1
        ActivationBoxed = "activation_boxed",
        /// 0 ≤ u ≤ 1
        ExcitationBoxed = "excitation_boxed",
        /// 0 ≤ a ≤ 1 and 0 ≤ u ≤ 1
        BothBoxed = "both_boxed",
    }
}

choices! {
    /// Instants at which activation enters the objective.
    LoadSharingGrid {
        /// at the measured instants t̂ (Table 1, first block)
        Measurement = "measurement",
        /// at the collocation points t (Table 1, second block)
        Collocation = "collocation",
    }
}

choices! {
    /// Start guess of a job; part of its identity.
    WarmStart {
        /// a guess by inverse dynamics
        Off = "off",
        /// its own solution on a mesh with half as many intervals, which is started in the same way, down to about ten
        Mesh = "mesh",
        /// the solution of the previous job if only the last axis differs, in blocks of at most 16 jobs
        Neighbour = "neighbour",
    }
}

choices! {
    /// When ranks are computed.
    RegularityMode {
        /// at every iterate and at the optimum
        EveryIteration = "every_iteration",
        /// only at the optimum, which is faster
        Optimum = "optimum",
        /// never; no verdicts on uniqueness and no sensitivities
        Off = "off",
    }
}

defaults!(Method::Dynamic, MuscleDynamics::Full, Criterion::Polynomial, EffortOf::Activation, EffortWeight::None,);

/// An inequality on each muscle; all are `≥ 0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoundKind {
    /// a ≥ 0
    Activation,
    /// u ≥ 0
    Excitation,
    /// 1 − a ≥ 0
    ActivationUpper,
    /// 1 − u ≥ 0
    ExcitationUpper,
    /// f_m ≥ 0: where a ≥ 0 is not imposed, so that no tendon pushes (eq. 11).
    Force,
}

impl BoundKind {
    /// As in the signal `bound_active`.
    pub fn name(self) -> &'static str {
        match self {
            BoundKind::Activation => "activation",
            BoundKind::Excitation => "excitation",
            BoundKind::ActivationUpper => "activation_upper",
            BoundKind::ExcitationUpper => "excitation_upper",
            BoundKind::Force => "force",
        }
    }
}

impl Bounds {
    /// The inequalities to impose: the requested ones, and `f_m ≥ 0` if `a ≥ 0` is not among them.
    pub fn kinds(self) -> Vec<BoundKind> {
        let mut kinds = match self {
            Bounds::None => vec![],
            Bounds::Activation => vec![BoundKind::Activation],
            Bounds::Excitation => vec![BoundKind::Excitation],
            Bounds::Both => vec![BoundKind::Activation, BoundKind::Excitation],
            Bounds::ActivationBoxed => vec![BoundKind::Activation, BoundKind::ActivationUpper],
            Bounds::ExcitationBoxed => vec![BoundKind::Excitation, BoundKind::ExcitationUpper],
            Bounds::BothBoxed => vec![
                BoundKind::Activation,
                BoundKind::Excitation,
                BoundKind::ActivationUpper,
                BoundKind::ExcitationUpper,
            ],
        };
        if !kinds.contains(&BoundKind::Activation) {
            kinds.push(BoundKind::Force);
        }
        kinds
    }
}
