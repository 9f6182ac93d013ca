//! Approximate eigenvectors of all slices, in elimination order, where the bases were: new pages are dear.

use super::EigenError;
use super::basis::Null;
use super::panel::{Row, WIDTH, ZERO};
use super::pool::{Panel, Panels, Pool, RUN};
use super::tiles::subtract_products;
use crate::simd::vectorised;
use std::collections::BTreeMap;

/// Some of the columns of several stores, in the order in which they lie there, eight to a panel.
pub(super) struct Vectors<'a> {
    stores: Vec<Panels<'a>>,
    /// Panel, counted through all stores, times eight and column there of each vector, ascending.
    places: Vec<usize>,
    /// Approximate eigenvalues of all columns, panel by panel.
    values: Vec<Row>,
}

/// Columns of panels, their eigenvalues as far as they are known, and the numbers of those that count, ascending.
pub(super) struct Store<'a> {
    pub panels: Panels<'a>,
    pub values: Vec<f64>,
    pub columns: Vec<usize>,
}

impl<'a> Vectors<'a> {
    pub fn new(stores: Vec<Store<'a>>) -> Result<Self, EigenError> {
        let (mut places, mut values) = (Vec::new(), Vec::new());
        for store in &stores {
            places.extend(store.columns.iter().map(|column| values.len() * WIDTH + column));
            let value = |column: usize| store.values.get(column).copied().unwrap_or(0.0);
            values.extend((0..store.panels.count()).map(|p| std::array::from_fn(|q| value(p * WIDTH + q))));
        }
        let stores = stores.into_iter().map(|store| store.panels.settle()).collect::<Result<_, _>>()?;
        Ok(Self { stores, places, values })
    }

    /// Columns with these eigenvalues, and these entries by row in elimination order.
    pub fn with(
        pool: &'a Pool,
        n: usize,
        values: &[f64],
        entry: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, EigenError> {
        let (mut panels, columns) = (Panels::new(pool), values.len());
        for p in 0..columns.div_ceil(WIDTH) {
            panels.grow()?;
            let Some((_, panel)) = panels.split() else { continue };
            for (i, row) in panel.as_flattened_mut().iter_mut().enumerate() {
                let inside = |j: usize| i < n && j < columns;
                *row = std::array::from_fn(|q| p * WIDTH + q).map(|j| if inside(j) { entry(i, j) } else { 0.0 });
            }
        }
        Self::new(vec![Store { panels, values: values.to_vec(), columns: (0..columns).collect() }])
    }

    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Panel and column there of each vector, ascending.
    pub fn places(&self) -> Vec<(usize, usize)> {
        self.places.iter().map(|place| (place / WIDTH, place % WIDTH)).collect()
    }

    /// The panels store by store, which takes them away.
    pub fn into_stores(self) -> Vec<Panels<'a>> {
        self.stores
    }

    /// All panels, which may hold more columns than count.
    pub fn panels(&self) -> Vec<&Panel> {
        self.stores.iter().flat_map(Panels::all).collect()
    }

    fn panels_mut(&mut self) -> Vec<&mut Panel> {
        self.stores.iter_mut().flat_map(Panels::all_mut).collect()
    }

    /// Which columns of a panel count.
    pub fn counts(&self, panel: usize) -> [bool; WIDTH] {
        std::array::from_fn(|q| self.places.binary_search(&(panel * WIDTH + q)).is_ok())
    }

    /// Approximate eigenvalues of all columns, panel by panel.
    pub fn values(&self) -> &[Row] {
        &self.values
    }

    /// Applies y_to -= factor y_from to the former vectors, all at once; steps are (to, from, factor), and `to` is `from` or above it.
    pub fn subtract_multiples(&mut self, steps: &[(usize, usize, f64)]) {
        let mut blocks = BTreeMap::new();
        for (to, from, factor) in steps {
            let (to, from) = (self.places[*to], self.places[*from]);
            let block = blocks.entry((to / WIDTH, from / WIDTH)).or_insert(ZERO);
            block[from % WIDTH][to % WIDTH] = *factor;
        }
        // Downwards, so that what is subtracted is still as it was.
        let blocks: Vec<_> = blocks.into_iter().rev().map(|((to, from), block)| (to, from, block)).collect();
        subtract_products(&mut self.panels_mut(), &blocks);
    }

    /// Subtracts the rows of a correction, in elimination order, from the columns of a panel that count, whose eigenvalues are these.
    pub fn correct(&mut self, panel: usize, correction: &[Row], values: &Row) {
        let counts = self.counts(panel);
        for (row, x) in self.panels_mut()[panel].as_flattened_mut().iter_mut().zip(correction) {
            for q in 0..WIDTH {
                if counts[q] {
                    row[q] -= x[q];
                }
            }
        }
        self.values[panel] = *values;
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
