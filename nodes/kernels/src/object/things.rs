//! Families that are made: most are rigid, some have a hinge.

use std::f64::consts::{PI, TAU};

use super::between;
use super::solid::{Body, Solid};
use crate::random::Random;

const UP: [f64; 3] = [0.0, 0.0, 1.0];
const SIDE: [f64; 3] = [1.0, 0.0, 0.0];
const FRONT: [f64; 3] = [0.0, 1.0, 0.0];

fn body(blend: f64) -> Body {
    Body { blend, ..Body::default() }
}

pub fn airplane(random: &mut Random) -> Body {
    let mut body = body(0.05);
    let fat = between(random, 0.09, 0.15);
    body.limb(&[[0.0, -1.0, 0.0], [0.0, -0.4, 0.0], [0.0, 0.6, 0.0], [0.0, 1.0, -0.02]], 0.6 * fat, fat);
    let (span, sweep, rise) = (between(random, 0.8, 1.2), between(random, 0.0, 0.5), between(random, -0.05, 0.15));
    let chord = between(random, 0.2, 0.35);
    let thick = between(random, 0.03, 0.05);
    for side in [-1.0, 1.0] {
        for i in 0..4 {
            let back = chord * (f64::from(i) / 3.0 - 0.5);
            let tip = [side * span, 0.1 - sweep + 0.5 * back, rise];
            body.cone([0.0, 0.1 + back, 0.0], tip, 1.3 * thick, thick);
        }
        for i in 0..2 {
            let back = 0.12 * f64::from(i);
            body.cone([0.0, -0.85 - back, 0.0], [side * 0.35, -0.95 - back - 0.3 * sweep, 0.03], thick, thick);
        }
        if random.unit() < 0.6 {
            let at = [side * 0.4 * span, 0.15 - 0.4 * sweep, -0.08];
            body.cone(at, [at[0], at[1] + 0.25, at[2]], 0.06, 0.07);
        }
    }
    for i in 0..2 {
        let back = 0.12 * f64::from(i);
        body.cone([0.0, -0.85 - back, 0.0], [0.0, -1.0 - back, 0.35], thick, thick);
    }
    body
}

pub fn cup(random: &mut Random) -> Body {
    let mut body = body(0.03);
    let (radius, half) = (between(random, 0.38, 0.55), between(random, 0.35, 0.7));
    let wall = between(random, 0.05, 0.09);
    body.can([0.0; 3], UP, radius, half);
    body.holes.push(Solid::Can {
        centre: [0.0, 0.0, 2.0 * wall + 0.5],
        axis: UP,
        radius: radius - wall,
        half: half + 0.5,
    });
    let size = between(random, 0.2, 0.3);
    let thick = between(random, 0.045, 0.07);
    let at = radius + 0.35 * size;
    let height = 0.2 * half * random.signed();
    body.ring([at, 0.0, height], FRONT, size, thick);
    // The inside again, as the handle reaches into it.
    body.holes.push(Solid::Can { centre: [0.0, 0.0, height], axis: UP, radius: radius - wall, half: 1.4 * size });
    body
}

pub fn glasses(random: &mut Random) -> Body {
    let mut body = body(0.02);
    let (size, thick) = (between(random, 0.25, 0.34), between(random, 0.03, 0.05));
    let gap = between(random, 0.06, 0.14);
    let filled = random.unit() < 0.3;
    let (length, fold, drop) = (between(random, 0.8, 1.1), 0.25 * random.signed(), between(random, 0.1, 0.25));
    for side in [-1.0, 1.0] {
        let centre = [side * (size + gap), 0.0, 0.0];
        body.ring(centre, FRONT, size, thick);
        if filled {
            body.can(centre, FRONT, size, 0.6 * thick);
        }
        let hinge = [side * (2.0 * size + gap), 0.0, 0.3 * size];
        let ear = [hinge[0] + side * fold, -length, hinge[2]];
        body.limb(&[hinge, ear, [ear[0], ear[1] - 0.15, ear[2] - drop]], thick, 0.9 * thick);
    }
    body.cone([-gap, 0.0, 0.05], [gap, 0.0, 0.05], thick, thick);
    body
}

pub fn chair(random: &mut Random) -> Body {
    let mut body = body(0.03);
    let (wide, deep, thick) = (between(random, 0.4, 0.5), between(random, 0.38, 0.5), between(random, 0.04, 0.07));
    body.block([0.0; 3], [wide, deep, thick], 0.03);
    let (leg, round) = (between(random, 0.6, 0.9), between(random, 0.045, 0.06));
    if random.unit() < 0.25 {
        body.cone([0.0; 3], [0.0, 0.0, -leg], 0.08, 0.08);
        for i in 0..5 {
            let a = TAU * f64::from(i) / 5.0;
            body.cone([0.0, 0.0, -leg], [0.5 * a.cos(), 0.5 * a.sin(), -leg - 0.1], round, round);
        }
    } else {
        let splay = 1.0 + 0.2 * random.unit();
        for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let (x, y) = (x * 0.85 * wide, y * 0.85 * deep);
            body.cone([x, y, 0.0], [splay * x, splay * y, -leg], round, round);
        }
    }
    let (back, lean) = (between(random, 0.7, 1.1), between(random, 0.0, 0.25));
    let top = |x: f64, t: f64| [x, -0.9 * deep - lean * t, back * t];
    match random.below(3) {
        0 => body.solids.push(Solid::Block {
            centre: top(0.0, 0.5),
            axis: [0.0, -lean, back],
            half: [0.9 * wide, thick, 0.5 * back],
            round: 0.03,
        }),
        1 => {
            for x in [-0.8, -0.3, 0.3, 0.8] {
                body.cone(top(x * wide, 0.0), top(x * wide, 1.0), round, round);
            }
            body.cone(top(-0.8 * wide, 1.0), top(0.8 * wide, 1.0), 1.2 * round, 1.2 * round);
        }
        _ => {
            for x in [-0.8, 0.8] {
                body.cone(top(x * wide, 0.0), top(x * wide, 1.0), round, round);
            }
            for t in [0.45, 0.72, 1.0] {
                body.cone(top(-0.8 * wide, t), top(0.8 * wide, t), 1.2 * round, 1.2 * round);
            }
        }
    }
    if random.unit() < 0.3 {
        for x in [-wide, wide] {
            body.limb(&[top(x, 0.35), [x, 0.6 * deep, 0.35 * back], [x, 0.6 * deep, 0.0]], round, round);
        }
    }
    body
}

pub fn table(random: &mut Random) -> Body {
    let mut body = body(0.03);
    let (wide, deep, thick) = (between(random, 0.6, 1.1), between(random, 0.5, 0.7), between(random, 0.04, 0.07));
    let (height, round) = (between(random, 0.5, 0.9), between(random, 0.045, 0.07));
    let is_round = random.unit() < 0.35;
    if is_round {
        body.can([0.0; 3], UP, 0.8 * wide, thick);
    } else {
        body.block([0.0; 3], [wide, deep, thick], 0.03);
    }
    if random.unit() < 0.3 {
        body.cone([0.0; 3], [0.0, 0.0, -height], 0.09, 0.09);
        body.can([0.0, 0.0, -height], UP, 0.45 * wide, 0.05);
        return body;
    }
    let inside = if is_round { 0.5 * wide } else { 0.85 * wide };
    let ahead = if is_round { 0.5 * wide } else { 0.85 * deep };
    for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        body.cone([x * inside, y * ahead, 0.0], [x * inside, y * ahead, -height], round, round);
    }
    if random.unit() < 0.4 {
        for x in [-inside, inside] {
            body.cone([x, -ahead, -0.7 * height], [x, ahead, -0.7 * height], 0.9 * round, 0.9 * round);
        }
    }
    body
}

pub fn plier(random: &mut Random) -> Body {
    let mut body = body(0.04);
    let (open, thick) = (between(random, 0.1, 0.7), between(random, 0.07, 0.1));
    let (long, jaw) = (between(random, 1.0, 1.4), between(random, 0.35, 0.6));
    body.can([0.0; 3], UP, 0.16, 0.1);
    for side in [-1.0, 1.0] {
        let a = side * 0.5 * open;
        let along = |r: f64, a: f64| [r * a.sin(), r * a.cos(), 0.0];
        let bulge = along(-0.5 * long, a - side * 0.25);
        body.limb(&[[0.0; 3], bulge, along(-long, a - side * 0.05)], thick, 0.9 * thick);
        body.limb(&[[0.0; 3], along(0.4 * jaw, a + side * 0.35), along(jaw, a)], thick, 0.6 * thick);
    }
    body
}

pub fn spring(random: &mut Random) -> Body {
    let mut body = body(0.0);
    let (turns, thick) = (3 + random.below(5), between(random, 0.06, 0.1));
    let (radius, rise) = (between(random, 0.35, 0.5), between(random, 0.28, 0.42));
    let steps = turns * 18;
    let at = |i: u64| {
        let a = TAU * i as f64 / 18.0;
        [radius * a.cos(), radius * a.sin(), rise * a / TAU]
    };
    let points: Vec<[f64; 3]> = (0..=steps).map(at).collect();
    body.limb(&points, thick, thick);
    body
}

pub fn mechanic(random: &mut Random) -> Body {
    let mut body = body(0.0);
    let half = [between(random, 0.6, 0.9), between(random, 0.35, 0.5), between(random, 0.1, 0.2)];
    body.block([0.0; 3], half, 0.02);
    // A wall at one end, or two.
    let wall = between(random, 0.3, 0.6);
    let walls = 1 + random.below(2);
    for x in [-1.0, 1.0].into_iter().take(walls as usize) {
        body.block([x * (half[0] - 0.1), 0.0, wall], [0.1, half[1], wall], 0.02);
        body.holes.push(Solid::Can {
            centre: [x * half[0], 0.0, 1.1 * wall],
            axis: SIDE,
            radius: 0.45 * half[1],
            half: 0.5,
        });
    }
    for x in [-0.4, 0.4].into_iter().take(1 + random.below(2) as usize) {
        body.holes.push(Solid::Can {
            centre: [x * half[0], 0.0, 0.0],
            axis: UP,
            radius: between(random, 0.09, 0.16),
            half: 1.0,
        });
    }
    if random.unit() < 0.5 {
        body.can([0.0, 0.0, half[2]], UP, 0.2, 0.25);
    }
    body
}

pub fn bearing(random: &mut Random) -> Body {
    let mut body = body(0.0);
    let (radius, half) = (between(random, 0.45, 0.6), between(random, 0.12, 0.3));
    let hole = radius * between(random, 0.4, 0.65);
    body.can([0.0; 3], FRONT, radius, half);
    body.holes.push(Solid::Can { centre: [0.0; 3], axis: FRONT, radius: hole, half: 2.0 });
    // The foot with its bolts.
    let foot = between(random, 0.9, 1.2);
    let thick = between(random, 0.08, 0.14);
    body.block([0.0, 0.0, -radius], [foot, half, thick], 0.02);
    for x in [-1.0, 1.0] {
        body.holes.push(Solid::Can { centre: [x * 0.8 * foot, 0.0, -radius], axis: UP, radius: 0.4 * half, half: 0.5 });
    }
    if random.unit() < 0.5 {
        body.can([0.0; 3], FRONT, radius - 0.08, half + 0.08);
    }
    body
}

pub fn vase(random: &mut Random) -> Body {
    let mut body = body(0.08);
    let (tall, belly, neck) = (between(random, 0.7, 1.2), between(random, 0.35, 0.55), between(random, 0.14, 0.3));
    let place = between(random, -0.3, 0.2) * tall;
    body.solids.push(Solid::Egg { centre: [0.0, 0.0, place], axis: UP, half: [belly, belly, 0.75 * tall] });
    body.can([0.0, 0.0, 0.6 * tall], UP, neck, 0.5 * tall);
    body.can([0.0, 0.0, -0.8 * tall], UP, 0.7 * belly, 0.08);
    let wall = 0.06;
    body.holes.push(Solid::Can { centre: [0.0, 0.0, 1.2 * tall], axis: UP, radius: neck - wall, half: 0.9 * tall });
    body.holes.push(Solid::Egg {
        centre: [0.0, 0.0, place],
        axis: UP,
        half: [belly - wall, belly - wall, 0.75 * tall - wall],
    });
    if random.unit() < 0.4 {
        for side in [-1.0, 1.0] {
            let points: Vec<[f64; 3]> = (0..=8)
                .map(|i| {
                    let a = PI * f64::from(i) / 8.0;
                    [
                        side * (neck + 0.32 * a.sin()),
                        0.0,
                        place + 0.35 * tall + (0.75 * tall - place - 0.35 * tall).max(0.3) * (1.0 - a.cos()) / 2.0,
                    ]
                })
                .collect();
            body.limb(&points[..], 0.05, 0.05);
        }
        body.holes.push(Solid::Can { centre: [0.0, 0.0, tall], axis: UP, radius: neck - wall, half: 0.6 * tall });
    }
    body
}
