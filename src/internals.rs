//! What the project's own tests and benchmarks use: no stable interface. Everything else is private, so that the compiler finds
//! what nothing uses.

pub mod compare {
    pub use crate::compare::{Tolerances, compare};
}
pub mod curves {
    pub use crate::curves::thesis::{active_force_length, passive_force_length, tendon_force};
    pub use crate::curves::{ActivationDynamics, MuscleCurves};
}
pub mod deadline {
    pub use crate::deadline::Deadline;
}
pub mod error {
    pub use crate::error::SourceFile;
}
pub mod methods {
    pub use crate::methods::InverseProblem;
    pub use crate::methods::dynamic::dynamic;
    pub use crate::methods::static_optimisation::{Labels, recruit};
    pub mod given_motion {
        pub use crate::methods::given_motion::{GivenMotion, Instant};
    }
    pub mod prediction {
        pub use crate::methods::prediction::{Setting, predict};
    }
}
pub mod model {
    pub use crate::model::{Model, Place};
    pub mod file {
        pub use crate::model::file::ModelFile;
    }
    pub mod mechanics {
        pub use crate::model::mechanics::{Level, Motion};
    }
    pub mod path {
        pub use crate::model::path::Path;
    }
    pub mod tree {
        pub use crate::model::tree::Tree;
        pub mod dynamics {
            pub use crate::model::tree::dynamics::{Dynamics, LEVELS, Level, Load, Point, State};
        }
    }
    pub mod spatial {
        pub use crate::model::spatial::Spatial;
    }
}
pub mod motion {
    pub use crate::motion::{Measurement, MotionTable, Surroundings};
}
pub mod nlp {
    pub mod curvature {
        pub use crate::nlp::curvature::Model;
    }
    pub mod damping {
        pub use crate::nlp::damping::Damping;
    }
    pub mod globalisation {
        pub use crate::nlp::globalisation::filter::{Filter, Verdict};
    }
    pub mod iterate {
        pub use crate::nlp::iterate::Iterate;
    }
    pub mod kkt {
        pub use crate::nlp::kkt::{Kkt, Rows};
    }
    pub mod options {
        pub use crate::nlp::options::SqpOptions;
    }
    pub mod polish {
        pub use crate::nlp::polish::active;
    }
    pub mod problem {
        pub use crate::nlp::problem::{ConvexTerm, Curvature, Multipliers, Problem};
    }
    pub mod recovery {
        pub use crate::nlp::recovery::{Next, Recovery};
    }
    pub mod regularity {
        pub use crate::nlp::regularity::{RankCounter, analyse_dense, deficiencies_by_qr};
    }
    pub mod restoration {
        pub use crate::nlp::restoration::restore;
    }
    pub mod sqp {
        pub use crate::nlp::sqp::{SqpOutcome, Start, solve, solve_with};
    }
    pub mod state {
        pub use crate::nlp::state::State;
    }
    pub mod subproblem {
        pub use crate::nlp::subproblem::{NoStep, Quality, Step, Way};
        pub mod active_set {
            pub use crate::nlp::subproblem::active_set::{Ceiling, solve};
        }
        pub mod interior_point {
            pub use crate::nlp::subproblem::interior_point::{Interior, Manner, solve};
        }
        pub mod qp {
            pub use crate::nlp::subproblem::qp::QuadraticProgramme;
        }
    }
    pub mod termination {
        pub use crate::nlp::termination::SqpStatus;
    }
    pub mod trace {
        pub use crate::nlp::trace::Record;
    }
}
pub mod numerics {
    pub mod bspline {
        pub use crate::numerics::bspline::{Basis, SplineSpace};
    }
    pub mod sparse {
        pub use crate::numerics::sparse::Sparse;
    }
}
pub mod opensim {
    pub use crate::opensim::{Imported, Weight, import};
}
pub mod outcome {
    pub use crate::outcome::{MuscleRow, Outcome, Status};
}
pub mod plausibility {
    pub use crate::plausibility::WARNING_KINDS;
}
pub mod prepare {
    pub use crate::prepare::{Prepared, Task};
}
pub mod problem {
    pub use crate::problem::{ControlProblem, Goal, Kind, QuantityId};
    pub mod goals {
        pub use crate::problem::goals::{Sample, Shape};
    }
}
pub mod recruitment {
    pub use crate::recruitment::{Criterion, Failure, Optimum, Programme, Term, missing};
}
pub mod reference {
    pub use crate::reference::{FileKind, keys, settings};
}
#[cfg(feature = "figures")]
pub mod report {
    pub mod svg {
        pub use crate::report::svg::drawing_code_hash;
    }
}
pub mod run {
    pub use crate::run::{Ended, RunOptions, Shard, run, run_with, task};
    pub mod collect {
        pub use crate::run::collect::merge;
    }
    pub mod reasons {
        pub use crate::run::reasons::{Reason, reasons};
    }
}
pub mod settings {
    pub use crate::settings::{
        Bounds, Criterion, EffortOf, EffortWeight, Initial, LoadSharingGrid, Method, MuscleDynamics, RegularityMode,
        Scheme, Settings, Value, WarmStart,
    };
}
pub mod skeleton {
    pub use crate::skeleton::{Role, Skeleton};
    pub mod file {
        pub use crate::skeleton::file::{ObstacleEntry, SkeletonFile};
    }
    pub mod frame {
        pub use crate::skeleton::frame::{Frame, Vector, cross, dot, minus, norm, unit};
    }
    pub mod surface {
        pub use crate::skeleton::surface::{Contact, Shape, Side, Wrap};
    }
    pub mod text {
        pub use crate::skeleton::text::text;
    }
    pub mod wrapping {
        pub use crate::skeleton::wrapping::{PlacedSurface, touches};
    }
}
pub mod solution {
    pub use crate::solution::Solution;
}
pub mod solve {
    pub use crate::solve::{solve, solve_from};
}
pub mod starts {
    pub use crate::starts::disturb;
}
pub mod study {
    pub use crate::study::{Job, Study, load_model, load_skeleton};
    pub mod file {
        pub use crate::study::file::schema;
    }
}
pub mod tables {
    pub use crate::tables::{STUDY, Table, Values, Writer, read};
    pub mod schema {
        pub use crate::tables::schema::{TABLES, TIMINGS, columns_of, row_of};
    }
}
pub mod transcription {
    pub mod coefficients {
        pub use crate::transcription::coefficients::Coefficients;
    }
    pub mod collocation {
        pub use crate::transcription::collocation::Collocation;
    }
    pub mod midpoint {
        pub use crate::transcription::midpoint::mesh;
    }
    pub mod radau {
        pub use crate::transcription::radau::Radau;
    }
    pub mod scheme {
        pub use crate::transcription::scheme::{Discretisation, evaluate};
    }
}
pub mod uniqueness {
    pub use crate::uniqueness::activation_intervals;
}
pub mod warm {
    pub use crate::warm::Answer;
}
