//! What a problem is about: functions of time, in families with a name.

/// How a function of time enters the equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Continuous; the equations have its derivatives up to `order`, 1 or 2.
    State { order: usize },
    /// Chosen freely at each instant, such as an excitation.
    Control,
    /// Determined by the equations at each instant, such as a joint reaction.
    Algebraic,
    /// Known beforehand.
    Given,
}

impl Kind {
    /// The highest derivative in the equations.
    pub fn order(self) -> usize {
        match self {
            Kind::State { order } => order,
            _ => 0,
        }
    }

    pub fn is_state(self) -> bool {
        matches!(self, Kind::State { .. })
    }
}

/// A family of functions of time.
#[derive(Clone, Debug)]
pub struct Quantity {
    /// As in `trajectories.parquet` if it is a signal there.
    pub name: &'static str,
    /// Name of each function, such as that of its muscle.
    pub members: Vec<String>,
    pub kind: Kind,
    /// The unit that the solver measures it in, in SI units.
    pub unit: f64,
}

/// The number of a quantity in its problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct QuantityId(pub usize);

/// Consecutive variables or equations at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    pub start: usize,
    pub count: usize,
}

impl Span {
    pub const EMPTY: Self = Self { start: 0, count: 0 };

    /// The place of member `i`, if there is one.
    pub fn get(self, i: usize) -> Option<usize> {
        (i < self.count).then_some(self.start + i)
    }

    /// The place of member `i`.
    pub fn at(self, i: usize) -> usize {
        debug_assert!(i < self.count);
        self.start + i
    }

    pub fn range(self) -> std::ops::Range<usize> {
        self.start..self.start + self.count
    }

    /// The values of the members.
    pub fn of(self, values: &[f64]) -> &[f64] {
        &values[self.range()]
    }

    /// This span and the next one together.
    pub fn and(self, next: Span) -> Span {
        assert_eq!(self.start + self.count, next.start, "the spans are neighbours");
        Span { start: self.start, count: self.count + next.count }
    }
}
