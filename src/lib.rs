pub mod error;
pub mod guess;
pub mod model;
pub mod motion;
pub mod nlp;
pub mod numerics;
pub mod study;
pub mod transcription;
