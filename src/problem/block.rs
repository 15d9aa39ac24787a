//! A term of the equations, and the sink that it is evaluated into.
//!
//! A block adds its terms to the equations at an instant: values, slopes (first derivatives by the variables z) and bends
//! (second derivatives of `multipliersᵀ equations`). One traversal serves all: the sink keeps what it is asked for. A block
//! hands out the same entries in the same order every time, zeros included, so that the sink records the sparsity
//! pattern once and afterwards knows the place of each entry without looking for it.

/// What is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    Values,
    Slopes,
    Bends,
}

/// One or more terms of the equations.
pub trait Block: Send + Sync {
    /// Adds its terms at the variables z.
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>);

    /// Groups of variables; of the curvature within each, the positive part makes a convex model of the Lagrangian.
    fn convex_groups(&self) -> Vec<Vec<usize>> {
        Vec::new()
    }

    /// Sets the weight of a step in its variables: what counts as a large step at z.
    fn weigh(&self, _z: &[f64], _weights: &mut [f64]) {}

    /// Replaces residuals that are solved in another form by those of the printed equation.
    fn print(&self, _z: &[f64], _residuals: &mut [f64]) {}
}

/// Receives the terms of blocks.
pub struct Sink<'s> {
    order: Order,
    out: &'s mut [f64],
    multipliers: &'s [f64],
    tape: Tape<'s>,
}

/// Where the entries go, in the order in which blocks hand them out.
enum Tape<'s> {
    Record(&'s mut Vec<(u32, u32)>),
    Replay { places: &'s [u32], next: usize },
}

impl<'s> Sink<'s> {
    fn new(order: Order, out: &'s mut [f64], multipliers: &'s [f64], tape: Tape<'s>) -> Self {
        Self { order, out, multipliers, tape }
    }

    pub fn wants(&self, order: Order) -> bool {
        self.order == order
    }

    /// Whether only the places of entries matter.
    pub fn is_recording(&self) -> bool {
        matches!(self.tape, Tape::Record(_))
    }

    /// Adds to the value of an equation.
    pub fn value(&mut self, row: usize, value: f64) {
        if self.order == Order::Values {
            self.out[row] += value;
        }
    }

    /// Adds to the derivative of an equation by a variable.
    pub fn slope(&mut self, row: usize, variable: usize, value: f64) {
        if self.order == Order::Slopes {
            self.entry(row, variable, value);
        }
    }

    /// Adds to a second derivative of `multipliersᵀ equations`, once for each unordered pair of variables.
    pub fn bend(&mut self, one: usize, other: usize, value: f64) {
        if self.order == Order::Bends {
            self.entry(one.min(other), one.max(other), value);
        }
    }

    /// The multiplier of an equation.
    pub fn multiplier(&self, row: usize) -> f64 {
        self.multipliers[row]
    }

    fn entry(&mut self, row: usize, column: usize, value: f64) {
        match &mut self.tape {
            Tape::Record(pairs) => pairs.push((row as u32, column as u32)),
            Tape::Replay { places, next } => {
                self.out[places[*next] as usize] += value;
                *next += 1;
            }
        }
    }
}

/// A recorded sparsity pattern.
#[derive(Clone, Debug, Default)]
pub struct Pattern {
    /// Distinct (row, column), sorted.
    pub entries: Vec<(usize, usize)>,
    /// The place among them of each entry that the blocks hand out.
    places: Vec<u32>,
}

impl Pattern {
    /// Records what the blocks hand out; `more`: entries that are there in any case.
    pub fn record(
        blocks: &[Box<dyn Block + '_>],
        order: Order,
        sizes: (usize, usize),
        more: impl Iterator<Item = (usize, usize)>,
    ) -> Self {
        let (z, multipliers) = (vec![0.0; sizes.1], vec![0.0; sizes.0]);
        let mut tape = Vec::new();
        let mut sink = Sink::new(order, &mut [], &multipliers, Tape::Record(&mut tape));
        blocks.iter().for_each(|block| block.evaluate(&z, &mut sink));
        let handed_out = tape.iter().map(|&(row, column)| (row as usize, column as usize));
        let mut entries: Vec<(usize, usize)> = handed_out.clone().chain(more).collect();
        entries.sort_unstable();
        entries.dedup();
        let place = |entry| entries.binary_search(&entry).expect("recorded") as u32;
        let places = handed_out.map(place).collect();
        Self { entries, places }
    }

    /// The place of an entry.
    pub fn place(&self, row: usize, column: usize) -> Option<usize> {
        self.entries.binary_search(&(row, column)).ok()
    }

    /// Evaluates the blocks into `out`, a number for each entry.
    pub fn replay(
        &self,
        blocks: &[Box<dyn Block + '_>],
        order: Order,
        z: &[f64],
        multipliers: &[f64],
        out: &mut [f64],
    ) {
        out.fill(0.0);
        let mut sink = Sink::new(order, out, multipliers, Tape::Replay { places: &self.places, next: 0 });
        blocks.iter().for_each(|block| block.evaluate(z, &mut sink));
        let Tape::Replay { next, .. } = sink.tape else { unreachable!("not recording") };
        assert_eq!(next, self.places.len(), "blocks hand out the same entries every time");
    }
}

/// The values of all equations at z.
pub fn values(blocks: &[Box<dyn Block + '_>], z: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    let mut sink = Sink::new(Order::Values, out, &[], Tape::Replay { places: &[], next: 0 });
    blocks.iter().for_each(|block| block.evaluate(z, &mut sink));
}
