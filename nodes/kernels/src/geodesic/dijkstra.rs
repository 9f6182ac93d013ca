//! Dijkstra's algorithm over a [`Graph`], bounded by a radius.

use super::graph::Graph;
use super::queue::Calendar;
use std::cmp::Ordering;

/// The vertices about a source, by whatever metric.
#[derive(Debug, Clone, Copy)]
pub struct Ball<'a> {
    /// The bounding distance asked for.
    pub radius: f64,
    /// The vertices no farther than `radius` with their distances, ascending by (distance, index).
    pub inside: &'a [(u32, f64)],
    /// Farther vertices with their distances, ascending too. All neighbours of inside vertices are here or inside.
    pub rim: &'a [(u32, f64)],
}

/// Workspace of Dijkstra's algorithm: allocated once per graph size, reused for any number of queries.
///
/// A query costs what it visits: vertices are stamped with the number of the query, so that nothing is reset.
#[derive(Debug, Clone, Default)]
pub struct Dijkstra {
    labels: Vec<Label>,
    epoch: u32,
    queue: Calendar,
    settled: Vec<(u32, f64)>,
}

/// What is known of a vertex, if `stamp` is of this query: `4 * epoch + state`.
#[derive(Debug, Clone, Copy, Default)]
struct Label {
    distance: f64,
    stamp: u32,
}

/// Reached, but not next to a vertex within the radius.
const REACHED: u32 = 0;
/// Next to a vertex within the radius: must be settled before a ball is complete.
const WANTED: u32 = 1;
const SETTLED: u32 = 2;

impl Dijkstra {
    /// An empty workspace; it grows on first use.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Stamps targets as wanted, each once, and queues the sources; how many targets are wanted.
    fn start(&mut self, graph: &Graph, sources: &[u32], targets: &[u32]) -> usize {
        self.queue.start(graph.mean, graph.longest);
        self.settled.clear();
        self.epoch += 1;
        if self.epoch > u32::MAX / 4 || self.labels.len() != graph.len() {
            self.labels.clear();
            self.labels.resize(graph.len(), Label::default());
            self.epoch = 1;
        }
        let (base, mut wanted) = (4 * self.epoch, 0);
        for &vertex in targets {
            if let Some(label) = self.labels.get_mut(vertex as usize).filter(|label| label.stamp < base) {
                *label = Label { distance: f64::INFINITY, stamp: base + WANTED };
                wanted += 1;
            }
        }
        for &vertex in sources {
            let Some(label) = self.labels.get_mut(vertex as usize) else { continue };
            if label.stamp < base || label.distance > 0.0 {
                *label = Label { distance: 0.0, stamp: label.stamp.max(base) };
                self.queue.push(0.0, vertex);
            }
        }
        wanted
    }

    /// Distances of all vertices from the nearest source; infinite where no path leads. Sources out of range are ignored.
    pub fn distances(&mut self, graph: &Graph, sources: &[u32]) -> Vec<f64> {
        self.start(graph, sources, &[]);
        let stamp = 4 * self.epoch;
        while let Some((distance, vertex)) = self.queue.pop() {
            if distance > self.labels[vertex as usize].distance {
                continue;
            }
            for (next, length) in graph.neighbours(vertex) {
                let (through, label) = (distance + length, &mut self.labels[next as usize]);
                // Lengths may overflow: what is infinitely far stays unreached.
                if through < if label.stamp == stamp { label.distance } else { f64::INFINITY } {
                    *label = Label { distance: through, stamp };
                    self.queue.push(through, next);
                }
            }
        }
        let found = |label: &Label| if label.stamp == stamp { label.distance } else { f64::INFINITY };
        self.labels.iter().map(found).collect()
    }

    /// Visits the vertices within `radius` of the nearest source, and their neighbours, at a cost set by the visited
    /// vertices alone. Sources out of range are ignored; a radius that is negative or not a number visits nothing.
    pub fn ball(&mut self, graph: &Graph, sources: &[u32], radius: f64) -> Ball<'_> {
        let inside = self.search(graph, sources, radius, &[]);
        let (inside, rim) = self.settled.split_at(inside);
        Ball { radius, inside, rim }
    }

    /// Distances of `targets` from the nearest source; the search ends when all of them are known.
    pub fn to(&mut self, graph: &Graph, sources: &[u32], targets: &[u32]) -> Vec<f64> {
        self.search(graph, sources, -1.0, targets);
        let settled = 4 * self.epoch + SETTLED;
        let found =
            |v: &u32| self.labels.get(*v as usize).filter(|l| l.stamp == settled).map_or(f64::INFINITY, |l| l.distance);
        targets.iter().map(found).collect()
    }

    /// Settles what is within the radius, its neighbours and the targets; how many are within.
    fn search(&mut self, graph: &Graph, sources: &[u32], radius: f64, targets: &[u32]) -> usize {
        let mut wanted = self.start(graph, sources, targets);
        let base = 4 * self.epoch;
        // Within the radius there is nothing to decide: the plain algorithm.
        let mut beyond = None;
        while let Some((distance, vertex)) = self.queue.pop() {
            if distance > self.labels[vertex as usize].distance {
                continue;
            }
            if distance.partial_cmp(&radius).is_none_or(Ordering::is_gt) {
                beyond = Some((distance, vertex));
                break;
            }
            self.settle(graph, distance, vertex);
        }
        let inside = self.settled.len();
        let Some((distance, vertex)) = beyond else { return inside };
        self.queue.push(distance, vertex);
        if inside > 0 {
            // What has been reached but not settled are the neighbours of what is within; they are wanted, too.
            let labels = &mut self.labels;
            self.queue.for_each(|distance, vertex| {
                let label = &mut labels[vertex as usize];
                if distance == label.distance && label.stamp == base + REACHED {
                    label.stamp = base + WANTED;
                    wanted += 1;
                }
            });
        }
        while wanted > 0 {
            let Some((distance, vertex)) = self.queue.pop() else { break };
            let label = &self.labels[vertex as usize];
            if distance > label.distance || label.stamp == base + SETTLED {
                continue;
            }
            wanted -= usize::from(label.stamp == base + WANTED);
            self.settle(graph, distance, vertex);
        }
        inside
    }

    fn settle(&mut self, graph: &Graph, distance: f64, vertex: u32) {
        let base = 4 * self.epoch;
        self.labels[vertex as usize].stamp = base + SETTLED;
        self.settled.push((vertex, distance));
        for (next, length) in graph.neighbours(vertex) {
            let (through, label) = (distance + length, &mut self.labels[next as usize]);
            // Lengths may overflow: what is infinitely far stays unreached.
            let (known, stamp) =
                if label.stamp >= base { (label.distance, label.stamp) } else { (f64::INFINITY, base + REACHED) };
            if through < known {
                *label = Label { distance: through, stamp };
                self.queue.push(through, next);
            }
        }
    }
}
