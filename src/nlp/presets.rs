//! Combinations of options that serve where others fail.

use super::options::SqpOptions;

impl SqpOptions {
    /// The options with each interior point from its own start to its end. Slower, and it goes down another one of many
    /// flat ways.
    pub fn thorough(mut self) -> Self {
        self.portfolio.to_the_end = true;
        self
    }
}
