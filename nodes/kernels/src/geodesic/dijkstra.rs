//! Shortest paths over a [`Graph`], bounded by a radius.
//!
//! What is known of a vertex is its distance so far, nothing else: eight bytes. Vertices wait in buckets ([`Front`]); those of one bucket are
//! taken in any order, and again if they turn out to be nearer. The distances are those of Dijkstra's algorithm to the last
//! bit, since either way a distance is the least of the rounded lengths of all paths, and rounded sums never fall as paths grow.

use super::graph::Graph;
use super::queue::{Front, Queue, Waiting};

/// The vertices about a source, by whatever metric. Their order is the same whenever the same is asked; it has no meaning.
#[derive(Debug, Clone, Copy)]
pub struct Ball<'a> {
    /// The bounding distance asked for.
    pub radius: f64,
    /// The vertices no farther than `radius`, with their distances.
    pub inside: &'a [(u32, f64)],
    /// Farther vertices with their distances. All neighbours of inside vertices are here or inside.
    pub rim: &'a [(u32, f64)],
}

/// Workspace of shortest paths: allocated once per graph size, reused for any number of queries.
///
/// A query costs what it visits: what it leaves behind is found from the lists of what it visited.
#[derive(Debug, Clone, Default)]
pub struct Dijkstra {
    /// Infinite between queries.
    distance: Vec<f64>,
    /// Whether the search goes on until the vertex is settled; false between queries.
    wanted: Vec<bool>,
    front: Front,
    settled: Vec<Waiting>,
    rim: Vec<Waiting>,
}

/// Whether settled vertices are listed.
const LISTED: bool = true;
const UNLISTED: bool = false;

impl Dijkstra {
    /// An empty workspace; it grows on first use.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Distances of all vertices from the nearest source; infinite where no path leads. Sources out of range are ignored.
    pub fn distances(&mut self, graph: &Graph, sources: &[u32]) -> Vec<f64> {
        let mut distance = vec![f64::INFINITY; graph.len()];
        self.front.start(graph.mean, graph.longest);
        seed(&mut self.front, &mut distance, sources);
        while self.front.advance() {
            settle::<UNLISTED>(&mut self.front, graph, &mut distance, f64::INFINITY, &mut self.settled);
        }
        distance
    }

    /// The vertices within `radius` of the nearest source with their distances, at a cost set by them alone, in no meaningful order.
    /// Sources out of range are ignored; nothing is within a radius that is negative or not a number.
    pub fn within(&mut self, graph: &Graph, sources: &[u32], radius: f64) -> &[(u32, f64)] {
        self.search(graph, sources, radius);
        forget(&mut self.distance, &self.settled);
        &self.settled
    }

    /// As [`Dijkstra::within`], and the neighbours of what is within.
    pub fn ball(&mut self, graph: &Graph, sources: &[u32], radius: f64) -> Ball<'_> {
        self.search(graph, sources, radius);
        let inside = self.settled.len();
        if inside > 0 {
            self.front.resume(radius);
            // The search went no farther than the radius, so that what can still be improved is outside.
            for &entry in self.settled.iter().filter(|e| e.1 + graph.longest > radius) {
                relax(&mut self.front, graph, &mut self.distance, f64::INFINITY, entry);
            }
            self.front.push_noted();
            let (mut count, wanted) = (0, &mut self.wanted);
            self.front.for_each(|vertex| count += usize::from(!std::mem::replace(&mut wanted[vertex as usize], true)));
            self.find_wanted(graph, count);
            self.forget_all();
        }
        let (inside, _) = self.settled.split_at(inside);
        Ball { radius, inside, rim: &self.rim }
    }

    /// Distances of `targets` from the nearest source; the search ends when all of them are known.
    pub fn to(&mut self, graph: &Graph, sources: &[u32], targets: &[u32]) -> Vec<f64> {
        self.start(graph);
        let mut count = 0;
        for &target in targets {
            let wanted = self.wanted.get_mut(target as usize);
            count += usize::from(wanted.is_some_and(|w| !std::mem::replace(w, true)));
        }
        seed(&mut self.front, &mut self.distance, sources);
        self.find_wanted(graph, count);
        let found = targets.iter().map(|v| self.distance.get(*v as usize).copied().unwrap_or(f64::INFINITY)).collect();
        self.forget_all();
        for &target in targets {
            self.wanted.get_mut(target as usize).into_iter().for_each(|w| *w = false); // those without a path
        }
        found
    }

    fn start(&mut self, graph: &Graph) {
        self.front.start(graph.mean, graph.longest);
        self.settled.clear();
        self.rim.clear();
        if self.distance.len() != graph.len() {
            self.distance = vec![f64::INFINITY; graph.len()];
            self.wanted = vec![false; graph.len()];
        }
    }

    /// Settles what is within the radius; distances are left as they are.
    fn search(&mut self, graph: &Graph, sources: &[u32], radius: f64) {
        self.start(graph);
        if radius >= 0.0 {
            seed(&mut self.front, &mut self.distance, sources);
            while self.front.advance() {
                settle::<LISTED>(&mut self.front, graph, &mut self.distance, radius.next_up(), &mut self.settled);
            }
        }
    }

    /// Goes on until so many wanted vertices are settled, which become the rim, or nothing is left.
    fn find_wanted(&mut self, graph: &Graph, mut count: usize) {
        while count > 0 && self.front.advance() {
            let from = self.settled.len();
            settle::<LISTED>(&mut self.front, graph, &mut self.distance, f64::INFINITY, &mut self.settled);
            for &(vertex, distance) in &self.settled[from..] {
                if std::mem::take(&mut self.wanted[vertex as usize]) {
                    self.rim.push((vertex, distance));
                    count -= 1;
                }
            }
        }
    }

    /// Makes all distances infinite again.
    fn forget_all(&mut self) {
        let distance = &mut self.distance;
        self.front.for_each(|vertex| distance[vertex as usize] = f64::INFINITY);
        forget(distance, &self.settled);
    }
}

/// Puts the sources at distance zero, each once.
fn seed(front: &mut Front, distance: &mut [f64], sources: &[u32]) {
    for &source in sources {
        if distance.get(source as usize).is_some_and(|d| *d > 0.0) {
            distance[source as usize] = 0.0;
            front.push(0.0, source);
        }
    }
}

/// Makes the neighbours of a vertex at a known distance nearer where the way over it is shorter, and shorter than `limit`; the front notes them.
#[inline(always)]
fn relax(front: &mut Front, graph: &Graph, distance: &mut [f64], limit: f64, (vertex, known): Waiting) {
    let links = graph.links(vertex);
    let nearer = links.iter().map(|link| {
        let (through, old) = (known + link.length(), &mut distance[link.vertex as usize]);
        // Lengths may overflow: what is infinitely far stays unreached.
        let better = through < if limit < *old { limit } else { *old };
        *old = if better { through } else { *old };
        (through, link.vertex, better)
    });
    front.note(links.len(), nearer);
}

fn forget(distance: &mut [f64], visited: &[Waiting]) {
    for &(vertex, _) in visited {
        distance[vertex as usize] = f64::INFINITY;
    }
}

/// Settles the front's present bucket, and lists its vertices. Paths of `limit` and longer are not followed.
fn settle<const LIST: bool>(
    front: &mut Front,
    graph: &Graph,
    distance: &mut [f64],
    limit: f64,
    settled: &mut Vec<Waiting>,
) {
    let (from, mut round) = (settled.len(), std::mem::take(&mut front.spare));
    // Mostly one round; where many links are shorter than a bucket is wide, too many may follow.
    let mut left = usize::MAX;
    while front.take(distance, &mut round) {
        left = left.min(256 + 8 * round.len());
        if round.len() > left {
            settle_in_order::<LIST>(front, graph, distance, limit, settled, &mut round);
            break;
        }
        left -= round.len();
        if LIST {
            settled.extend_from_slice(&round);
        }
        // Some may become nearer meanwhile. To see them twice costs less than to look whether they did.
        for &entry in &round {
            relax(front, graph, distance, limit, entry);
        }
        front.push_noted();
    }
    front.spare = round;
    if LIST {
        // Without those that were found nearer afterwards, in the same bucket. A flag moves the end: a branch would be guessed wrong.
        let mut end = from;
        for at in from..settled.len() {
            let entry = settled[at];
            settled[end] = entry;
            end += usize::from(entry.1 == distance[entry.0 as usize]);
        }
        settled.truncate(end);
    }
}

/// The same, nearest first, so that nothing is followed twice.
#[cold]
fn settle_in_order<const LIST: bool>(
    front: &mut Front,
    graph: &Graph,
    distance: &mut [f64],
    limit: f64,
    settled: &mut Vec<Waiting>,
    round: &mut Vec<Waiting>,
) {
    let mut heap = Queue::default();
    for &(vertex, distance) in round.iter() {
        heap.push(distance, vertex);
    }
    while let Some((known, vertex)) = heap.pop() {
        if known == distance[vertex as usize] {
            if LIST {
                settled.push((vertex, known));
            }
            relax(front, graph, distance, limit, (vertex, known));
            front.push_noted();
        }
        front.take(distance, round);
        for &(vertex, distance) in round.iter() {
            heap.push(distance, vertex);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// By one heap, in order.
    fn textbook(graph: &Graph, source: u32) -> Vec<f64> {
        let (mut queue, mut distance) = (Queue::default(), vec![f64::INFINITY; graph.len()]);
        distance[source as usize] = 0.0;
        queue.push(0.0, source);
        while let Some((known, vertex)) = queue.pop() {
            for (next, length) in graph.neighbours(vertex) {
                if known == distance[vertex as usize] && known + length < distance[next as usize] {
                    distance[next as usize] = known + length;
                    queue.push(known + length, next);
                }
            }
        }
        distance
    }

    #[test]
    fn lengths_of_all_sizes_give_the_textbook_distances() {
        let mut random = Random::new(&[9]);
        let n = 900;
        for (power, zeros, whole) in [(1, 0.0, false), (12, 0.1, false), (40, 0.3, true), (1, 1.0, false)] {
            // A band: paths are many and long, and with high powers most are far shorter than a bucket is wide.
            let mut pairs = Vec::new();
            for v in 0..n - 1 {
                for w in (v + 1..n).take(5).filter(|w| whole || *w != 700) {
                    let length = if random.unit() < zeros { 0.0 } else { random.unit().powi(power) };
                    pairs.push(([v as u32, w as u32], length));
                }
            }
            let graph = Graph::from_pairs(n, &pairs);
            let mut work = Dijkstra::new();
            for source in [0, 450] {
                let full = textbook(&graph, source);
                assert_eq!(work.distances(&graph, &[source]), full);
                let targets = [source + 3, 3, 899, 700, 5000];
                let far = full.iter().copied().filter(|d| d.is_finite()).fold(0.0, f64::max);
                for radius in [0.0, 0.1 * far, 0.6 * far, far, f64::INFINITY] {
                    let known = |&(v, d): &Waiting| full[v as usize] == d;
                    let count = full.iter().filter(|d| **d <= radius && d.is_finite()).count();
                    let within = work.within(&graph, &[source], radius);
                    assert!(within.len() == count && within.iter().all(known));
                    let ball = work.ball(&graph, &[source], radius);
                    assert!(ball.inside.len() == count && ball.inside.iter().all(known));
                    assert!(ball.rim.iter().all(|e| known(e) && e.1 > radius));
                    let found = work.to(&graph, &[source], &targets);
                    assert_eq!(found, targets.map(|t| full.get(t as usize).copied().unwrap_or(f64::INFINITY)));
                }
            }
        }
    }
}
