//! Approximate eigenvectors of all slices, in elimination order, in the memory of the lowest one's basis, which becomes the result's: new pages are dear.

use super::basis::Null;
use super::certify::{UNCERTIFIED, guesses};
use super::panel::{Row, Rows, WIDTH, ZERO};
use super::parts::Pass;
use super::pool::{Panel, Panels, Pool, RUN};
use super::scratch::Kept;
use super::tiles::subtract_products;
use super::{EigenError, Hooks};
use crate::simd::vectorised;
use std::collections::BTreeMap;
use std::ops::Range;

/// Some of the columns of panels, in the order in which they lie there.
pub(super) struct Vectors<'a> {
    pool: &'a Pool,
    /// The panels, in memory that begins with room for null vectors.
    rows: Rows,
    /// Panel times eight and column there of each vector, ascending.
    places: Vec<usize>,
    /// Approximate eigenvalues of all columns, panel by panel.
    values: Vec<Row>,
}

/// Columns of panels, their eigenvalues as far as they are known, and the numbers of those that count, ascending.
pub(super) struct Store<'a> {
    pub panels: Kept<'a>,
    pub values: Vec<f64>,
    pub columns: Vec<usize>,
}

impl<'a> Vectors<'a> {
    /// Brings the vectors of slices together, behind those of the first.
    pub fn new(pool: &'a Pool, stores: Vec<Store<'a>>) -> Result<Self, EigenError> {
        let (mut places, mut values) = (Vec::new(), Vec::new());
        for store in &stores {
            places.extend(store.columns.iter().map(|column| values.len() * WIDTH + column));
            let chunk = |p: usize| store.values.get(p * WIDTH..).map_or([0.0; WIDTH], guesses);
            values.extend((0..store.panels.count()).map(chunk));
        }
        let mut kept = stores.into_iter().map(|store| store.panels);
        let Some(first) = kept.next() else { return Err(UNCERTIFIED) };
        let mut begin = first.count();
        let mut rows = first.into_piece(pool, values.len())?;
        for panels in kept {
            let end = begin + panels.count();
            panels.fetch(pool.split_mut(&mut rows).drain(begin..end).collect())?;
            // Memory is short while they are in two places.
            pool.clear();
            begin = end;
        }
        Ok(Self { pool, rows, places, values })
    }

    /// All columns of these panels, with their eigenvalues.
    pub fn of_all(pool: &'a Pool, panels: Panels<'a>, values: Vec<f64>) -> Result<Self, EigenError> {
        let columns = (0..values.len()).collect();
        Self::new(pool, vec![Store { panels: Kept::Here(panels), values, columns }])
    }

    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Panel and column there of each vector, ascending.
    pub fn places(&self) -> Vec<(usize, usize)> {
        self.places.iter().map(|place| (place / WIDTH, place % WIDTH)).collect()
    }

    /// All panels, which may hold more columns than count.
    pub fn panels(&self) -> Vec<&Panel> {
        let mut panels = self.pool.split(&self.rows);
        panels.truncate(self.values.len());
        panels
    }

    fn panels_mut(&mut self) -> Vec<&mut Panel> {
        self.pool.split_mut(&mut self.rows)
    }

    /// Where these vectors lie in the result, column after column, overwriting their panels and those before them.
    pub fn columns_mut(&mut self, n: usize, vectors: Range<usize>) -> &mut [f64] {
        let front = self.pool.front();
        &mut self.rows.memory_mut()[front + n * vectors.start..front + n * vectors.end]
    }

    /// The result, and whatever is behind it.
    pub fn into_memory(self) -> Vec<f64> {
        self.rows.into_memory()
    }

    /// Approximate eigenvalues of all columns, panel by panel.
    pub fn values(&self) -> &[Row] {
        &self.values
    }

    /// Applies y_to -= factor y_from to the former vectors, all at once; steps are (to, from, factor), and `to` is `from` or above it.
    pub fn subtract_multiples(&mut self, steps: &[(usize, usize, f64)], hooks: &dyn Hooks) -> Result<(), EigenError> {
        let mut blocks = BTreeMap::new();
        for (to, from, factor) in steps {
            let (to, from) = (self.places[*to], self.places[*from]);
            let block = blocks.entry((to / WIDTH, from / WIDTH)).or_insert(ZERO);
            block[from % WIDTH][to % WIDTH] = *factor;
        }
        // Downwards, so that what is subtracted is still as it was.
        let blocks: Vec<_> = blocks.into_iter().rev().map(|((to, from), block)| (to, from, block)).collect();
        let panels = self.panels_mut();
        let pass = Pass::new(hooks, panels.first().map_or(0, |panel| panel.len()), blocks.len());
        pass.run(pass.split(panels), |_, mut part| subtract_products(&mut part, &blocks))
    }
}

/// What goes by when a panel of y is put in order by vertex.
pub(super) struct Moments {
    /// The largest magnitude of a product with a null vector.
    pub null: f64,
    /// The weighted sums of cubes, and of their magnitudes, up to a common factor.
    pub cubes: Row,
    pub magnitudes: Row,
}

/// Fills rows by vertex from rows in elimination order, each multiplied by the scale at its vertex.
pub(super) fn by_vertex(panel: &Panel, order: &[u32], scale: &[f64], null: &Null, rows: &mut [Row]) -> Moments {
    let mut products = vec![[0.0; WIDTH]; null.count];
    let [mut cubes, mut magnitudes] = [[0.0; WIDTH]; 2];
    vectorised(
        #[inline(always)]
        || {
            let [mut cubed, mut size] = [[0.0; WIDTH]; 2];
            for (run, (y, order)) in panel.iter().zip(order.chunks(RUN)).enumerate() {
                null.add_product(run, y, &mut products);
                for (y, &vertex) in y.iter().zip(order) {
                    let x = y.map(|y| y * scale[vertex as usize]);
                    for q in 0..WIDTH {
                        cubed[q] = (y[q] * y[q]).mul_add(x[q], cubed[q]);
                        size[q] = (y[q] * y[q]).mul_add(x[q].abs(), size[q]);
                    }
                    rows[vertex as usize] = x;
                }
            }
            (cubes, magnitudes) = (cubed, size);
        },
    );
    let null = products.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
    Moments { null, cubes, magnitudes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn sums_on_the_way_are_those_of_plain_loops() {
        const N: usize = RUN - 3;
        let mut random = Random::from_state(8);
        let panel = [std::array::from_fn(|_| std::array::from_fn(|_| random.signed()))];
        let order: Vec<u32> = (0..N).map(|i| (7 * i % N) as u32).collect();
        let scale: Vec<f64> = (0..N).map(|_| 0.5 + random.unit()).collect();
        // Components take turns.
        let labels = (0..N).map(|i| (i / 5 % 3) as u32).collect();
        let null = Null { labels, units: (0..N).map(|_| random.signed()).collect(), count: 3 };
        let mut rows = vec![[0.0; WIDTH]; N];
        let moments = by_vertex(&panel, &order, &scale, &null, &mut rows);
        let mut largest = 0.0f64;
        for q in 0..WIDTH {
            let y = |i: usize| panel[0][i][q];
            assert!((0..N).all(|i| rows[order[i] as usize][q] == y(i) * scale[order[i] as usize]));
            for label in 0..3 {
                let own = (0..N).filter(|&i| null.labels[i] == label);
                largest = largest.max(own.map(|i| null.units[i] * y(i)).sum::<f64>().abs());
            }
            let cubes = |i: usize| y(i) * y(i) * rows[order[i] as usize][q];
            assert!((moments.cubes[q] - (0..N).map(cubes).sum::<f64>()).abs() < 1e-12);
            assert!((moments.magnitudes[q] - (0..N).map(|i| cubes(i).abs()).sum::<f64>()).abs() < 1e-12);
        }
        assert!((moments.null - largest).abs() < 1e-12 && largest > 0.1);
    }
}
