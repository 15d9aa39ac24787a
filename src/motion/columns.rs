//! Columns of numbers over time, by name, from a table.

use super::low_pass::{HIGHEST_CUTOFF, smooth_spline};
use super::text::{Row, TextTable, at_line};
use crate::error::{Result, SourceFile, nearest};
use crate::numerics::cubic::CubicSpline;
use crate::skeleton::frame::Vector;

/// Splines of a vector's components.
pub type Curve = Box<[CubicSpline; 3]>;

/// A vector's components at time `t`.
pub fn vector_at(curve: &Curve, t: f64) -> Vector {
    [0, 1, 2].map(|i| curve[i].at(t)[0])
}

/// Columns of numbers by name, and their instants.
pub struct Columns<'f> {
    file: &'f SourceFile,
    pub text: TextTable,
    pub time: Vec<f64>,
    smoothing_hz: f64,
}

impl<'f> Columns<'f> {
    /// Reads the table (.csv, .sto or .mot) and its instants; `smoothing_hz`: cut-off of the low-pass, 0 for none.
    ///
    /// # Errors
    /// If there are no instants, they do not increase, or the cut-off is too high for them.
    pub fn new(file: &'f SourceFile, smoothing_hz: f64) -> Result<Self> {
        let is_csv = file.path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
        let text = if is_csv { TextTable::csv(file)? } else { TextTable::storage(file)? };
        let mut columns = Self { file, text, time: Vec::new(), smoothing_hz };
        let name = ["time", "time_s"].into_iter().find(|name| columns.text.names.iter().any(|own| own == name));
        let Some(name) = name else {
            let help = "name the column of instants in seconds `time`";
            return Err(columns.text.error(file, "there is no column `time`", help));
        };
        columns.time = columns.numbers(name, "the table", &|_| true)?;
        if columns.time.len() < 2 {
            return Err(columns.text.error(file, "the table has fewer than two rows", "give the forces over time"));
        }
        if let Some(row) = columns.time.windows(2).position(|pair| pair[1] <= pair[0]) {
            let line = columns.text.rows[row + 1].line;
            let message = format!("line {line}: time {} s is not later than the row before", columns.time[row + 1]);
            return Err(at_line(file, line, message, "sort the rows by time and remove repeated instants"));
        }
        check_cutoff(file, &columns.time, smoothing_hz)?;
        Ok(columns)
    }

    /// The numbers of a column, which `user` needs; in rows that are not `needed` gaps count as 0.
    ///
    /// # Errors
    /// If the column is not there, or a number that is needed is not finite.
    pub fn numbers(&self, name: &str, user: &str, needed: &dyn Fn(usize) -> bool) -> Result<Vec<f64>> {
        let Some(column) = self.text.names.iter().position(|own| own == name) else {
            let near = nearest(name, self.text.names.iter().map(String::as_str));
            let near = near.map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
            let help = format!("{near}the table has: {}", self.text.names.join(", "));
            let message = format!("there is no column `{name}`, which {user} needs");
            return Err(self.text.error(self.file, message, &help));
        };
        let number = |(k, row): (usize, &Row)| {
            let field = &row.fields[column];
            let number = field.parse::<f64>().ok().filter(|x| x.is_finite()).or((!needed(k)).then_some(0.0));
            number.ok_or_else(|| {
                let message = format!("line {}: `{field}` in column `{name}` is not a finite number", row.line);
                at_line(self.file, row.line, message, "fill gaps beforehand: Sinew does not guess measurements")
            })
        };
        self.text.rows.iter().enumerate().map(number).collect()
    }

    /// The columns `<prefix>x`, `<prefix>y` and `<prefix>z`, as in [`Columns::numbers`].
    ///
    /// # Errors
    /// If one is not there, or a number is not finite.
    pub fn vectors(
        &self,
        prefix: &Option<String>,
        user: &str,
        needed: &dyn Fn(usize) -> bool,
    ) -> Result<Option<Vec<Vector>>> {
        let Some(prefix) = prefix else { return Ok(None) };
        let [x, y, z] = ["x", "y", "z"].map(|axis| self.numbers(&format!("{prefix}{axis}"), user, needed));
        let (x, y, z) = (x?, y?, z?);
        Ok(Some((0..x.len()).map(|i| [x[i], y[i], z[i]]).collect()))
    }

    /// Splines through vectors at the instants.
    pub fn curve(&self, vectors: &[Vector]) -> Curve {
        Box::new([0, 1, 2].map(|axis| self.spline(&vectors.iter().map(|vector| vector[axis]).collect::<Vec<f64>>())))
    }

    /// A spline through numbers at the instants.
    pub fn spline(&self, values: &[f64]) -> CubicSpline {
        smooth_spline(&self.time, values, self.smoothing_hz)
    }
}

/// Refuses a cut-off frequency that is too high for a table's instants.
///
/// # Errors
/// If it is.
pub fn check_cutoff(file: &SourceFile, time: &[f64], cutoff_hz: f64) -> Result<()> {
    let rate = (time.len() - 1) as f64 / (time[time.len() - 1] - time[0]);
    if cutoff_hz <= HIGHEST_CUTOFF * rate {
        return Ok(());
    }
    let name = file.path.display();
    let message = format!("{name}: a cut-off of {cutoff_hz} Hz, but the table has {rate:.0} instants per second");
    let help = format!("the cut-off may be at most {HIGHEST_CUTOFF} times that, {:.0} Hz", HIGHEST_CUTOFF * rate);
    Err(file.error(None, message, "", Some(help)))
}
