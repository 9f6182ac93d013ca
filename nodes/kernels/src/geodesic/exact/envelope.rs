//! The windows of each edge: which source is nearest on which part of it.

use super::window::{Cone, contest};
use crate::geodesic::queue::Queue;

const NONE: u32 = u32::MAX;
/// No window of this edge matters any more.
const CLOSED: u32 = u32::MAX - 1;
/// Intervals shorter than this share of their edge are left to their neighbours: next to the ray at which a path begins to bend two distances
/// differ by the square of the distance from it, so that rounding alone makes slivers of 1e-9, and those would multiply.
const TINY: f64 = 1e-8;
/// Marks the newcomer among the owners of spans.
const NEW: u32 = u32::MAX;

/// A window in the lists: 64 bytes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub(super) cone: Cone,
    /// The distance it is queued by.
    key: f64,
    pub(super) edge: u32,
    /// The face it came through.
    pub(super) from: u32,
    next: u32,
    queued: bool,
    live: bool,
}

#[derive(Debug, Clone, Copy)]
struct Head {
    stamp: u32,
    first: u32,
}

/// The windows of all edges; they do not overlap.
#[derive(Debug, Clone, Default)]
pub(super) struct Envelope {
    windows: Vec<Window>,
    free: Vec<u32>,
    heads: Vec<Head>,
    stamp: u32,
    /// Workspace of an insertion: who owns what, and the windows there were.
    spans: Vec<(f64, f64, u32)>,
    replaced: Vec<u32>,
}

impl Envelope {
    /// Empties all lists, at no cost unless the number of edges has changed.
    pub(super) fn start(&mut self, edges: usize) {
        self.stamp = self.stamp.wrapping_add(1);
        if self.heads.len() != edges || self.stamp == 0 {
            self.heads.clear();
            self.heads.resize(edges, Head { stamp: 0, first: NONE });
            self.stamp = 1;
        }
        self.windows.clear();
        self.free.clear();
    }

    fn first(&self, edge: u32) -> u32 {
        let head = self.heads[edge as usize];
        if head.stamp == self.stamp { head.first } else { NONE }
    }

    /// Whether windows of an edge are refused from now on.
    pub(super) fn is_closed(&self, edge: u32) -> bool {
        self.first(edge) == CLOSED
    }

    /// Drops an edge's windows and refuses new ones.
    pub(super) fn close(&mut self, edge: u32) {
        let mut at = self.first(edge);
        while at < CLOSED {
            let next = self.windows[at as usize].next;
            self.release(at);
            at = next;
        }
        self.heads[edge as usize] = Head { stamp: self.stamp, first: CLOSED };
    }

    fn release(&mut self, id: u32) {
        self.windows[id as usize].queued = false;
        self.free.push(id);
    }

    /// The window that left the queue with this number and key, if it still waits; it is queued anew if it has been cut
    /// back to what is farther.
    pub(super) fn take(&mut self, id: u32, key: f64, queue: &mut Queue, tag: u32) -> Option<Window> {
        let window = &mut self.windows[id as usize];
        if !window.queued || window.key != key {
            return None;
        }
        let least = window.cone.least();
        if least > key {
            window.key = least;
            queue.push(least, id | tag);
            return None;
        }
        window.queued = false;
        Some(*window)
    }

    /// Adds a window where it is nearer than those there, cutting them back, and queues what there is of it.
    pub(super) fn insert(&mut self, edge: u32, from: u32, cone: Cone, length: f64, queue: &mut Queue, tag: u32) {
        let tiny = TINY * length;
        let (mut before, mut at) = (NONE, self.first(edge));
        while at != NONE && self.windows[at as usize].cone.end <= cone.start {
            before = at;
            at = self.windows[at as usize].next;
        }
        let first = at;
        let after = self.divide(&cone, at, tiny);
        if !self.spans.iter().any(|s| s.2 == NEW) {
            return;
        }
        self.replaced.clear();
        let mut old = first;
        while old != after {
            let window = &mut self.windows[old as usize];
            window.live = false;
            self.replaced.push(old);
            old = window.next;
        }
        let spans = std::mem::take(&mut self.spans);
        for &(start, end, owner) in &spans {
            let id = if owner == NEW {
                let cone = Cone { start, end, ..cone };
                self.add(
                    Window { cone, key: cone.least(), edge, from, next: NONE, queued: true, live: true },
                    queue,
                    tag,
                )
            } else {
                let window = self.windows[owner as usize];
                let cone = Cone { start, end, ..window.cone };
                if window.live {
                    self.add(Window { cone, ..window }, queue, tag)
                } else {
                    self.windows[owner as usize] = Window { cone, live: true, ..window };
                    owner
                }
            };
            self.link(edge, before, id);
            before = id;
        }
        self.link(edge, before, after);
        self.spans = spans;
        for i in 0..self.replaced.len() {
            if !self.windows[self.replaced[i] as usize].live {
                self.release(self.replaced[i]);
            }
        }
    }

    fn link(&mut self, edge: u32, before: u32, next: u32) {
        match before {
            NONE => self.heads[edge as usize] = Head { stamp: self.stamp, first: next },
            _ => self.windows[before as usize].next = next,
        }
    }

    fn add(&mut self, window: Window, queue: &mut Queue, tag: u32) -> u32 {
        let id = if let Some(id) = self.free.pop() {
            self.windows[id as usize] = window;
            id
        } else {
            self.windows.push(window);
            self.windows.len() as u32 - 1
        };
        if window.queued {
            queue.push(window.key, id | tag);
        }
        id
    }

    /// Writes to `spans` who owns what of the newcomer's interval and of the windows from `at` that it overlaps; the first
    /// window beyond it.
    fn divide(&mut self, cone: &Cone, mut at: u32, tiny: f64) -> u32 {
        self.spans.clear();
        let mut done = cone.start;
        while at != NONE && self.windows[at as usize].cone.start < cone.end {
            let Window { cone: old, next, .. } = self.windows[at as usize];
            if old.start > done {
                self.span(done, old.start, NEW, tiny);
                done = old.start;
            }
            self.span(old.start, done, at, tiny);
            let end = old.end.min(cone.end);
            let verdict = contest(cone, &old, done, end);
            for &(stop, newcomer) in &verdict.parts[..verdict.count] {
                let owner = if newcomer && stop - done > tiny { NEW } else { at };
                self.span(done, stop, owner, tiny);
                done = stop;
            }
            self.span(end, old.end, at, tiny);
            done = end;
            at = next;
        }
        self.span(done, cone.end, NEW, tiny);
        at
    }

    fn span(&mut self, start: f64, end: f64, owner: u32, tiny: f64) {
        match self.spans.last_mut() {
            Some(last) if last.2 == owner && last.1 == start => last.1 = end.max(start),
            _ if end - start > tiny => self.spans.push((start, end, owner)),
            _ => {}
        }
    }
}
