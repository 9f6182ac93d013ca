//! The linear relaxation behind the bound, solved approximately: restarted primal-dual hybrid gradient.
//!
//! The *tight* relaxation has a product `y_ab` for every pair term and, for every candidate `a` and every feature `f` of either side,
//!
//! ```text
//! maximise  c'x + h'y    subject to   sum_{a of f} x_a <= 1,    sum_{b of f} y_ab <= x_a,    x, y >= 0
//! ```
//!
//! (with = on the side that must be matched). Its dual variables are `p_f` and, a *slot* each, `q_af`; they are all that is taken from here:
//! they say how to split each `h_ab` between its two stars (see [`super::bound`]), and **any** split is valid there. So nothing in
//! this file needs to be exact, and it runs in `f32`; a wrong number here costs quality of a bound, never its truth.
//!
//! Method: PDHG (Chambolle & Pock 2011) with diagonal steps (Pock & Chambolle 2011), reflected Halpern averaging and restarts on the fixed-point
//! residual (Lu & Yang 2024), weight of primal against dual steps set anew at each restart (Applegate et al. 2021).

use super::lap::FORBIDDEN;
use super::sub::Sub;
use crate::stop::{Pace, Stop};

/// What a subproblem keeps of the iterates, so that its children start where it ended. Slots are stored with every entry that is in them.
#[derive(Clone, Default)]
pub(super) struct Guide {
    /// Per variable.
    pub x: Vec<f32>,
    /// Per left, per right feature.
    pub p: [Vec<f32>; 2],
    /// Per entry: the product, and the slots of the row's variable with the column's left and right feature.
    pub y: Vec<f32>,
    pub q: [Vec<f32>; 2],
    pub weight: f32,
}

/// The state in flat form: variables, edges, features (left ones first), slots, and one slot that is always 0.
pub(super) struct Relax {
    n: [usize; 4],
    feature: Vec<[u32; 2]>,
    c: Vec<f32>,
    h: Vec<f32>,
    /// Of each edge: its entry with the higher column.
    entry: Vec<u32>,
    /// Of each edge (a, b): of a with b's left and right, of b with a's left and right.
    slots: Vec<[u32; 4]>,
    owner: Vec<u32>,
    /// Lower bounds of the dual variables: 0, or none where the primal constraint is an equation.
    floor: Vec<f32>,
    /// Steps; the primal ones are divided, the dual ones multiplied by `weight`.
    step: Vec<f32>,
    weight: f32,
    z: Vec<f32>,
    anchor: Vec<f32>,
    next: Vec<f32>,
    gain: Vec<f32>,
    load: Vec<f32>,
    /// Iterations since the last restart, and in all.
    since: usize,
    total: usize,
    first: f32,
    last: f32,
}

const NONE: u32 = u32::MAX;

/// The constraints on products, one for each variable and feature that needs one.
struct Slots {
    /// Of each entry, with the column's left and right feature; [`NONE`] where there is no constraint.
    slot: [Vec<u32>; 2],
    owner: Vec<u32>,
    /// Where its dual variable starts.
    value: Vec<f32>,
    count: Vec<f32>,
    /// Whether it is an equation.
    free: Vec<bool>,
}

impl Slots {
    fn new(sub: &Sub, pace: &Pace) -> Self {
        let (n, features) = (sub.vars.len(), sub.n_left() + sub.n_right);
        let live = |e: usize| sub.w[e] != FORBIDDEN;
        let mut slot = [vec![NONE; sub.col.len()], vec![NONE; sub.col.len()]];
        let (mut owner, mut value, mut count, mut free) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut at = vec![(NONE, 0_u32); features];
        let mut size = vec![0_u32; features];
        for a in (0..n).take_while(|_| !pace.ends()) {
            let feature =
                |e: usize| [sub.left[sub.col[e] as usize], sub.right[sub.col[e] as usize] + sub.n_left() as u32];
            for e in sub.entries(a).filter(|&e| live(e)) {
                for f in feature(e) {
                    size[f as usize] += 1;
                }
            }
            for e in sub.entries(a).filter(|&e| live(e)) {
                let [l, r] = feature(e).map(|f| f as usize);
                // A constraint on one product alone follows from the other side's.
                let needed = [sub.dense || size[l] > 1 || size[r] == 1, size[r] > 1];
                for (side, f) in [l, r].into_iter().enumerate().filter(|s| needed[s.0]) {
                    if at[f] != (a as u32, at[f].1) {
                        at[f] = (a as u32, owner.len() as u32);
                        owner.push(a as u32);
                        value.push(sub.guide.q[side][e]);
                        count.push(1.0 + size[f] as f32);
                        free.push(sub.dense && side == 0);
                    }
                    slot[side][e] = at[f].1;
                }
            }
            for e in sub.entries(a) {
                for f in feature(e) {
                    size[f as usize] = 0;
                }
            }
        }
        Self { slot, owner, value, count, free }
    }
}

impl Relax {
    /// Ready to run. If stopped meanwhile it lacks constraints, which makes it a worse relaxation, not a wrong one.
    pub fn new(sub: &Sub, stop: Stop) -> Self {
        let (n, features) = (sub.vars.len(), sub.n_left() + sub.n_right);
        let live = |e: usize| sub.w[e] != FORBIDDEN;
        let Slots { slot, owner, value, count, free } = Slots::new(sub, &Pace::new(stop, 64));
        let dummy = owner.len() as u32;
        let of = |side: usize, e: usize| if slot[side][e] == NONE { dummy } else { slot[side][e] };
        let edges = || (0..n).flat_map(|a| sub.entries(a).filter(move |&e| sub.col[e] as usize > a && live(e)));
        let entry: Vec<u32> = edges().map(|e| e as u32).collect();
        let mate = |e: usize| sub.mate[e] as usize;
        let mut relax = Self {
            n: [n, entry.len(), features, owner.len()],
            feature: sub.left.iter().zip(&sub.right).map(|(&l, &r)| [l, r + sub.n_left() as u32]).collect(),
            c: sub.c.iter().map(|&c| (c as f64 / sub.unit) as f32).collect(),
            h: edges().map(|e| ((sub.w[e] + sub.w[mate(e)]) as f64 / sub.unit) as f32).collect(),
            slots: edges().map(|e| [of(0, e), of(1, e), of(0, mate(e)), of(1, mate(e))]).collect(),
            entry,
            owner,
            floor: Vec::new(),
            step: Vec::new(),
            weight: sub.guide.weight,
            z: Vec::new(),
            anchor: Vec::new(),
            next: Vec::new(),
            gain: vec![0.0; n],
            load: Vec::new(),
            since: 0,
            total: 0,
            first: 0.0,
            last: 0.0,
        };
        relax.prepare(sub, &value, &count, &free);
        relax
    }

    /// Steps, bounds of the duals, and the starting point.
    fn prepare(&mut self, sub: &Sub, value: &[f32], count: &[f32], free: &[bool]) {
        let [n, _, features, _] = self.n;
        let mut degree = vec![2.0_f32; n];
        self.owner.iter().for_each(|&a| degree[a as usize] += 1.0);
        let mut size = vec![0.0_f32; features];
        self.feature.iter().flatten().for_each(|&f| size[f as usize] += 1.0);
        self.step.extend(degree.iter().map(|d| 1.0 / d));
        self.step.extend(self.entry.iter().map(|_| 0.25));
        self.step.extend(size.iter().map(|s| 1.0 / s.max(1.0)));
        self.step.extend(count.iter().map(|s| 1.0 / s));
        self.step.push(0.0);
        let low = |free: bool| if free { f32::NEG_INFINITY } else { 0.0 };
        self.floor.extend((0..features).map(|f| low(sub.mandatory && f < sub.n_left())));
        self.floor.extend(free.iter().map(|&f| low(f)));
        self.z.extend(&sub.guide.x);
        self.z.extend(self.entry.iter().map(|&e| sub.guide.y[e as usize]));
        self.z.extend(sub.guide.p.iter().flatten());
        self.z.extend(value);
        self.z.push(0.0);
        self.anchor = self.z.clone();
        self.next = self.z.clone();
        self.load = vec![0.0; features + self.owner.len() + 1];
    }

    /// One step of PDHG from `z` to `next`; the squared lengths of its primal and dual part.
    fn step(&mut self) -> (f32, f32) {
        let [n, edges, features, slots] = self.n;
        let (z_primal, z_dual) = self.z.split_at(n + edges);
        let (next_primal, next_dual) = self.next.split_at_mut(n + edges);
        let (p, q) = z_dual.split_at(features);
        let (load_p, load_q) = self.load.split_at_mut(features);
        let down = 1.0 / self.weight;
        self.gain.copy_from_slice(&self.c);
        for (&a, &q) in self.owner.iter().zip(q) {
            self.gain[a as usize] += q;
        }
        load_p.fill(-1.0);
        let mut primal = 0.0;
        let variables = z_primal.iter().zip(next_primal.iter_mut()).zip(&self.step).zip(&mut self.gain);
        for ((((&old, new), &step), gain), f) in variables.zip(&self.feature) {
            let f = f.map(|f| f as usize);
            *new = (old + down * step * (*gain - p[f[0]] - p[f[1]])).max(0.0);
            let change = *new - old;
            primal += change * change / step;
            // From here on the extrapolated x.
            *gain = *new + change;
            load_p[f[0]] += *gain;
            load_p[f[1]] += *gain;
        }
        load_q.fill(0.0);
        let (step, mut moved) = (0.25 * down, 0.0);
        let products = z_primal[n..].iter().zip(&mut next_primal[n..]).zip(&self.h).zip(&self.slots);
        for (((&old, new), &h), s) in products {
            let s = s.map(|s| s as usize);
            *new = (old + step * (h - (q[s[0]] + q[s[1]]) - (q[s[2]] + q[s[3]]))).max(0.0);
            let change = *new - old;
            moved += change * change;
            let bar = *new + change;
            for s in s {
                load_q[s] += bar;
            }
        }
        for (load, &a) in load_q.iter_mut().zip(&self.owner) {
            *load -= self.gain[a as usize];
        }
        let mut dual = 0.0;
        let last = features + slots;
        let constraints = z_dual[..last].iter().zip(next_dual).zip(&self.step[n + edges..]).zip(&self.load);
        for ((((&old, new), &step), &load), &floor) in constraints.zip(&self.floor) {
            *new = (old + self.weight * step * load).max(floor);
            let change = *new - old;
            dual += change * change / step;
        }
        (primal + 4.0 * moved, dual)
    }

    /// Goes on for some iterations, or until `stop`.
    pub fn run(&mut self, iterations: usize, stop: Stop) {
        for _ in 0..iterations {
            if stop() {
                break;
            }
            let (primal, dual) = self.step();
            let residual = (primal * self.weight + dual / self.weight).sqrt();
            if self.since == 0 {
                (self.first, self.last) = (residual, residual);
            }
            let enough = residual <= 0.2 * self.first;
            let stalled = residual <= 0.8 * self.first && residual > self.last;
            let long = self.since > 20 && 0.36 * self.total as f64 <= self.since as f64;
            self.last = residual;
            self.total += 1;
            if self.since > 0 && (enough || stalled || long) {
                self.restart();
                continue;
            }
            let new = (self.since as f32 + 1.0) / (self.since as f32 + 2.0);
            let old = 1.0 - new;
            for ((z, &t), &anchor) in self.z.iter_mut().zip(&self.next).zip(&self.anchor) {
                *z = new * (2.0 * t - *z) + old * anchor;
            }
            self.since += 1;
        }
    }

    fn restart(&mut self) {
        let split = self.n[0] + self.n[1];
        let mut moved = [0.0_f32; 2];
        for (k, ((&t, &anchor), &step)) in self.next.iter().zip(&self.anchor).zip(&self.step).enumerate() {
            if step > 0.0 {
                moved[usize::from(k >= split)] += (t - anchor) * (t - anchor) / step;
            }
        }
        if moved[0] > 1e-12 && moved[1] > 1e-12 {
            // Halfway, on the logarithmic scale, to what would balance the two.
            self.weight = (self.weight * (moved[1] / moved[0]).sqrt()).sqrt().clamp(1e-4, 1e4);
        }
        self.z.copy_from_slice(&self.next);
        self.anchor.copy_from_slice(&self.next);
        self.since = 0;
    }

    /// Splits every pair term as the duals say, and keeps the iterates.
    pub fn store(&self, sub: &mut Sub) {
        let [n, edges, features, _] = self.n;
        let (x, rest) = self.next.split_at(n);
        let (y, rest) = rest.split_at(edges);
        let (p, q) = rest.split_at(features);
        sub.guide.x.copy_from_slice(x);
        let (left, right) = p.split_at(sub.n_left());
        sub.guide.p[0].copy_from_slice(left);
        sub.guide.p[1].copy_from_slice(right);
        sub.guide.weight = self.weight;
        for (k, (&entry, slots)) in self.entry.iter().zip(&self.slots).enumerate() {
            let (e, f) = (entry as usize, sub.mate[entry as usize] as usize);
            if sub.w[e] == FORBIDDEN {
                continue;
            }
            let q = slots.map(|s| q[s as usize]);
            (sub.guide.y[e], sub.guide.y[f]) = (y[k], y[k]);
            (sub.guide.q[0][e], sub.guide.q[1][e]) = (q[0], q[1]);
            (sub.guide.q[0][f], sub.guide.q[1][f]) = (q[2], q[3]);
            let share = f64::from(0.5 * (self.h[k] + (q[0] + q[1]) - (q[2] + q[3])));
            sub.split(e, share * sub.unit);
        }
    }
}
