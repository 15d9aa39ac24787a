//! Matrices in compressed sparse column format, with a pattern that is built once and values that are rewritten often.

use std::sync::Arc;

/// A sparse matrix in compressed column format. Row indices increase within each column; explicit zeros are kept.
/// Clones share the pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct Sparse {
    pub rows: usize,
    pub columns: usize,
    /// Start of each column in `row_index` and `values`; length `columns + 1`.
    pub column_start: Arc<[usize]>,
    pub row_index: Arc<[u32]>,
    pub values: Vec<f64>,
}

/// Collects the positions of a sparsity pattern, and afterwards gives the slot in `values` of each.
#[derive(Clone, Debug)]
pub struct Pattern {
    rows: usize,
    columns: usize,
    /// (column, row) of each position added; sorted and without duplicates after [`Pattern::build`].
    entries: Vec<(u32, u32)>,
    column_start: Vec<usize>,
}

impl Pattern {
    pub fn new(rows: usize, columns: usize) -> Self {
        Self { rows, columns, entries: Vec::new(), column_start: Vec::new() }
    }

    /// Adds a position. Duplicates are allowed.
    pub fn add(&mut self, row: usize, column: usize) {
        debug_assert!(row < self.rows && column < self.columns);
        self.entries.push((column as u32, row as u32));
    }

    /// Builds the zero matrix with this pattern. [`Pattern::slot`] may be called from now on.
    pub fn build(&mut self) -> Sparse {
        // Sort by column (counting sort), then by row within each column.
        let mut end = vec![0; self.columns + 1];
        self.entries.iter().for_each(|&(column, _)| end[column as usize + 1] += 1);
        (0..self.columns).for_each(|column| end[column + 1] += end[column]);
        let mut rows = vec![0; self.entries.len()];
        for &(column, row) in &self.entries {
            let end = &mut end[column as usize];
            rows[*end] = row;
            *end += 1;
        }
        self.entries.clear();
        self.column_start = vec![0];
        let mut start = 0;
        for column in 0..self.columns {
            let column_rows = &mut rows[start..end[column]];
            column_rows.sort_unstable();
            for &row in column_rows.iter() {
                if self.entries.last() != Some(&(column as u32, row)) {
                    self.entries.push((column as u32, row));
                }
            }
            self.column_start.push(self.entries.len());
            start = end[column];
        }
        Sparse {
            rows: self.rows,
            columns: self.columns,
            column_start: self.column_start.as_slice().into(),
            row_index: self.entries.iter().map(|&(_, row)| row).collect(),
            values: vec![0.0; self.entries.len()],
        }
    }

    /// The index in `values` of a position in the pattern.
    pub fn slot(&self, row: usize, column: usize) -> usize {
        let (from, to) = (self.column_start[column], self.column_start[column + 1]);
        let place = self.entries[from..to].binary_search_by_key(&(row as u32), |&(_, row)| row);
        from + place.expect("the position is in the pattern")
    }
}

impl Sparse {
    /// The matrix with these (row, column, value) entries; values at the same position are summed.
    pub fn from_triplets(rows: usize, columns: usize, triplets: &[(usize, usize, f64)]) -> Self {
        let mut pattern = Pattern::new(rows, columns);
        triplets.iter().for_each(|&(row, column, _)| pattern.add(row, column));
        let mut matrix = pattern.build();
        for &(row, column, value) in triplets {
            matrix.values[pattern.slot(row, column)] += value;
        }
        matrix
    }

    /// The same pattern with empty `values`.
    pub fn without_values(&self) -> Self {
        let (column_start, row_index) = (self.column_start.clone(), self.row_index.clone());
        Self { column_start, row_index, values: Vec::new(), ..*self }
    }

    /// (row, value) of each entry in a column.
    pub fn column(&self, column: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let slots = self.column_start[column]..self.column_start[column + 1];
        self.row_index[slots.clone()].iter().map(|&row| row as usize).zip(self.values[slots].iter().copied())
    }

    /// (row, column, slot) of each entry, in storage order.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        (0..self.columns).flat_map(move |column| {
            (self.column_start[column]..self.column_start[column + 1])
                .map(move |slot| (self.row_index[slot] as usize, column, slot))
        })
    }

    /// `out += scale · self · x`
    pub fn add_product(&self, scale: f64, x: &[f64], out: &mut [f64]) {
        for column in 0..self.columns {
            let factor = scale * x[column];
            if factor != 0.0 {
                self.column(column).for_each(|(row, value)| out[row] += value * factor);
            }
        }
    }

    /// `out += scale · selfᵀ · y`
    pub fn add_transpose_product(&self, scale: f64, y: &[f64], out: &mut [f64]) {
        for column in 0..self.columns {
            let sum: f64 = self.column(column).map(|(row, value)| value * y[row]).sum();
            out[column] += scale * sum;
        }
    }

    /// `out += scale · S · x` for the symmetric matrix S whose upper triangle is `self`.
    pub fn add_symmetric_product(&self, scale: f64, x: &[f64], out: &mut [f64]) {
        for column in 0..self.columns {
            let slots = self.column_start[column]..self.column_start[column + 1];
            let (mut rows, mut values) = (&self.row_index[slots.clone()], &self.values[slots]);
            let factor = scale * x[column];
            // The diagonal entry, if present, is the last one in its column.
            if let ([above @ .., last], [others @ .., value]) = (rows, values)
                && *last as usize == column
            {
                out[column] += value * factor;
                (rows, values) = (above, others);
            }
            let mut sum = 0.0;
            for (&row, value) in rows.iter().zip(values) {
                out[row as usize] += value * factor;
                sum += value * x[row as usize];
            }
            out[column] += scale * sum;
        }
    }

    /// Upper triangle of `selfᵀ · self`.
    pub fn gram(&self) -> Sparse {
        let mut by_row = vec![Vec::new(); self.rows];
        for (row, column, slot) in self.entries() {
            by_row[row].push((column, self.values[slot]));
        }
        let mut triplets = Vec::new();
        for row in &by_row {
            for (i, &(column_i, value_i)) in row.iter().enumerate() {
                triplets.extend(row[i..].iter().map(|&(column_j, value_j)| (column_i, column_j, value_i * value_j)));
            }
        }
        Sparse::from_triplets(self.columns, self.columns, &triplets)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_agree_with_dense_products() {
        let a = Sparse::from_triplets(2, 3, &[(0, 0, 1.0), (1, 2, 2.0), (0, 2, 3.0), (0, 0, 0.5)]);
        let mut y = vec![0.0; 2];
        a.add_product(2.0, &[1.0, 5.0, 1.0], &mut y);
        assert_eq!(y, [9.0, 4.0]);
        let mut x = vec![0.0; 3];
        a.add_transpose_product(1.0, &[1.0, 10.0], &mut x);
        assert_eq!(x, [1.5, 0.0, 23.0]);
        let gram = a.gram();
        let mut z = vec![0.0; 3];
        gram.add_symmetric_product(1.0, &[1.0, 5.0, 1.0], &mut z);
        assert_eq!(z, [6.75, 0.0, 17.5]);
    }
}
