//! Dense kernels on columns that are stored one after the other.

use nalgebra::{DMatrixView, DMatrixViewMut, Dyn};
use rayon::prelude::*;

/// Columns that are worked on without products of matrices.
const FEW: usize = 8;
/// Columns of a product that are computed as one.
const STRIP: usize = 64;
/// nalgebra multiplies matrices of at most so many rows or columns in loops, which leave their memory where rows are
/// apart (`gemv` of 0.35).
const SMALL: usize = 5;
/// Multiplications in a product that are worth another thread: a hundredth of a millisecond.
const MANY: usize = 1 << 18;

/// A matrix within a slice, with the distances between its rows and columns.
#[derive(Clone, Copy)]
pub struct Part<'a> {
    pub data: &'a [f64],
    pub row_stride: usize,
    pub column_stride: usize,
}

impl<'a> Part<'a> {
    pub fn of(data: &'a [f64], height: usize) -> Self {
        Self {
            data,
            row_stride: 1,
            column_stride: height,
        }
    }

    pub fn transpose(self) -> Self {
        Self {
            data: self.data,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
        }
    }

    fn view(self, rows: usize, columns: usize) -> DMatrixView<'a, f64, Dyn, Dyn> {
        let [rows, columns] = [rows, columns].map(Dyn);
        let [row_stride, column_stride] = [self.row_stride, self.column_stride].map(Dyn);
        DMatrixView::from_slice_with_strides_generic(
            self.data,
            rows,
            columns,
            row_stride,
            column_stride,
        )
    }

    fn columns_from(self, column: usize) -> Self {
        Self {
            data: &self.data[column * self.column_stride..],
            ..self
        }
    }

    fn rows_from(self, row: usize) -> Self {
        Self {
            data: &self.data[row * self.row_stride..],
            ..self
        }
    }
}

/// Which part of a matrix is computed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    Whole,
    /// On and below the diagonal; what is above it may be computed or not.
    Lower,
}

/// A matrix to write to, in columns of `height` values.
pub struct Target<'a> {
    pub data: &'a mut [f64],
    pub height: usize,
    pub rows: usize,
    pub columns: usize,
    pub shape: Shape,
}

/// C ← β C + α A B, with `inner` columns of A.
pub fn add_product(beta: f64, c: Target<'_>, alpha: f64, a: Part<'_>, b: Part<'_>, inner: usize) {
    let (height, rows, columns) = (c.height, c.rows, c.columns);
    if rows == 0 || columns == 0 {
        return;
    }
    let strip = |(at, data): (usize, &mut [f64])| {
        let first = at * STRIP;
        let skipped = if c.shape == Shape::Lower { first } else { 0 };
        let strip = Target {
            data: &mut data[skipped..],
            height,
            rows: rows - skipped,
            columns: STRIP.min(columns - first),
            shape: Shape::Whole,
        };
        let (a, b) = (a.rows_from(skipped), b.columns_from(first));
        if strip.rows.min(strip.columns).min(inner) <= SMALL {
            add_small_product(beta, strip, alpha, a, b, inner);
        } else {
            let (a, b) = (a.view(strip.rows, inner), b.view(inner, strip.columns));
            let [rows, columns] = [strip.rows, strip.columns].map(Dyn);
            let (one, height) = (Dyn(1), Dyn(height));
            DMatrixViewMut::from_slice_with_strides_generic(strip.data, rows, columns, one, height)
                .gemm(alpha, &a, &b, beta);
        }
    };
    let strips = columns.div_ceil(STRIP);
    if rows * columns * inner >= MANY {
        let all = c.data.par_chunks_mut(STRIP * height).enumerate();
        all.take(strips).for_each(strip);
    } else {
        let all = c.data.chunks_mut(STRIP * height).enumerate();
        all.take(strips).for_each(strip);
    }
}

/// As [`add_product`], in loops.
fn add_small_product(beta: f64, c: Target<'_>, alpha: f64, a: Part<'_>, b: Part<'_>, inner: usize) {
    for (j, column) in c.data.chunks_mut(c.height).enumerate().take(c.columns) {
        let column = &mut column[..c.rows];
        if beta == 0.0 {
            column.fill(0.0);
        }
        for k in 0..inner {
            let factor = alpha * b.data[k * b.row_stride + j * b.column_stride];
            let of_a = &a.data[k * a.column_stride..];
            if a.row_stride == 1 {
                let pairs = column.iter_mut().zip(of_a);
                pairs.for_each(|(c, a)| *c += factor * a);
            } else {
                let pairs = column.iter_mut().zip(of_a.iter().step_by(a.row_stride));
                pairs.for_each(|(c, a)| *c += factor * a);
            }
        }
    }
}

/// Replaces the lower part of the first columns of a symmetric matrix by those of its Cholesky factor. `panel` begins with
/// column `first`, in columns of `height` rows; the rows above the diagonal are not used.
///
/// # Errors
/// The column whose pivot is not positive or not finite.
pub fn cholesky(
    panel: &mut [f64],
    height: usize,
    first: usize,
    columns: usize,
) -> Result<(), usize> {
    if columns <= FEW {
        for j in 0..columns {
            let (before, column) = panel.split_at_mut(j * height);
            let column = &mut column[first + j..height];
            for earlier in before.chunks_exact(height) {
                let earlier = &earlier[first + j..];
                let factor = earlier[0];
                for (value, earlier) in column.iter_mut().zip(earlier) {
                    *value -= factor * earlier;
                }
            }
            let pivot = column[0];
            if !(pivot > 0.0 && pivot.is_finite()) {
                return Err(first + j);
            }
            let root = pivot.sqrt();
            column[0] = root;
            let inverse = 1.0 / root;
            column[1..].iter_mut().for_each(|value| *value *= inverse);
        }
        return Ok(());
    }
    let half = (columns / 2).next_multiple_of(FEW);
    cholesky(panel, height, first, half)?;
    let (left, right) = panel.split_at_mut(half * height);
    let next = first + half;
    let a = Part::of(&left[next..], height);
    let rest = Target {
        data: &mut right[next..],
        height,
        rows: height - next,
        columns: columns - half,
        shape: Shape::Lower,
    };
    add_product(1.0, rest, -1.0, a, a.transpose(), half);
    cholesky(right, height, next, columns - half)
}

/// W ← W L⁻¹, with W of `height` rows and a lower triangular L in columns of `l_height` rows.
pub fn solve_from_right(w: &mut [f64], height: usize, l: &[f64], l_height: usize, columns: usize) {
    if columns <= FEW {
        for j in (0..columns).rev() {
            let (before, after) = w.split_at_mut((j + 1) * height);
            let column = &mut before[j * height..];
            for (k, later) in after.chunks_exact(height).take(columns - j - 1).enumerate() {
                let factor = l[j * l_height + j + 1 + k];
                for (value, later) in column.iter_mut().zip(later) {
                    *value -= factor * later;
                }
            }
            let inverse = 1.0 / l[j * l_height + j];
            column.iter_mut().for_each(|value| *value *= inverse);
        }
        return;
    }
    let half = (columns / 2).next_multiple_of(FEW);
    let (left, right) = w.split_at_mut(half * height);
    solve_from_right(
        right,
        height,
        &l[half * (l_height + 1)..],
        l_height,
        columns - half,
    );
    let rest = Target {
        data: left,
        height,
        rows: height,
        columns: half,
        shape: Shape::Whole,
    };
    let (solved, below) = (Part::of(right, height), Part::of(&l[half..], l_height));
    add_product(1.0, rest, -1.0, solved, below, columns - half);
    solve_from_right(left, height, l, l_height, half);
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn products_of_all_shapes_and_strides_are_those_of_their_definition() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for case in 0..3000 {
            let [columns, inner] = [0; 2].map(|_: usize| rng.random_range(1..150));
            let shape = [Shape::Whole, Shape::Lower][rng.random_range(0..2)];
            let rows = match shape {
                Shape::Lower => columns + rng.random_range(0..40),
                Shape::Whole => rng.random_range(1..60),
            };
            let height = rows + rng.random_range(0..10);
            let mut random = |rows: usize, columns: usize| {
                DMatrix::from_fn(rows, columns, |_, _| rng.random_range(-1.0..1.0))
            };
            let (a, b) = (random(rows, inner), random(inner, columns));
            let mut c = random(height, columns);
            let (a_rows, b_rows) = (a.transpose(), b.transpose());
            let beta = [0.0, 1.0][case % 2];
            let mut expected = c.clone();
            let mut top = expected.rows_mut(0, rows);
            top *= beta;
            top -= &a * &b;
            let of_a = [
                Part::of(a.as_slice(), rows),
                Part::of(a_rows.as_slice(), inner).transpose(),
            ][case / 2 % 2];
            let of_b = [
                Part::of(b.as_slice(), inner),
                Part::of(b_rows.as_slice(), columns).transpose(),
            ][case / 4 % 2];
            let target = Target {
                data: c.as_mut_slice(),
                height,
                rows,
                columns,
                shape,
            };
            add_product(beta, target, -1.0, of_a, of_b, inner);
            for j in 0..columns {
                for i in 0..height {
                    if shape == Shape::Whole || i >= j {
                        let error = (c[(i, j)] - expected[(i, j)]).abs();
                        assert!(error < 1e-12, "{case}: {i}, {j}: {error}");
                    }
                }
            }
        }
    }
}
