//! Families that live: their joints bend.

use super::between;
use super::solid::{Body, Solid};
use crate::random::Random;
use crate::vec3::{add, scale};

/// A unit vector: `up` from the horizontal, `round` about z from x, in radians.
fn toward(round: f64, up: f64) -> [f64; 3] {
    [up.cos() * round.cos(), up.cos() * round.sin(), up.sin()]
}

/// Points of a limb from `start`: for each part its length and direction.
fn chain(start: [f64; 3], parts: &[(f64, [f64; 3])]) -> Vec<[f64; 3]> {
    let mut points = vec![start];
    for (length, direction) in parts {
        let last = points[points.len() - 1];
        points.push(add(last, scale(*direction, *length)));
    }
    points
}

/// Trunk, head and four limbs: z up, x to the side.
struct Figure {
    trunk: f64,
    width: f64,
    head: f64,
    arm: [f64; 2],
    leg: [f64; 2],
}

impl Figure {
    /// A figure in a random pose, bent by up to `bend` radians.
    fn body(&self, random: &mut Random, bend: f64) -> Body {
        let mut body = Body { blend: 0.12, ..Body::default() };
        let w = self.width;
        body.solids.push(Solid::Egg {
            centre: [0.0, 0.0, 0.5 * self.trunk],
            axis: [0.0, 0.0, 1.0],
            half: [w, 0.65 * w, 0.62 * self.trunk],
        });
        let neck = [0.0, 0.0, 1.02 * self.trunk];
        let head = add(neck, [0.0, 0.08 * random.signed(), 1.1 * self.head]);
        body.cone([0.0, 0.0, 0.8 * self.trunk], head, 0.45 * self.head, 0.45 * self.head);
        body.egg(head, [0.8 * self.head, 0.9 * self.head, self.head]);
        for side in [-1.0, 1.0] {
            let outward = if side < 0.0 { std::f64::consts::PI } else { 0.0 };
            let mut turn = |base: f64| base + bend * random.signed();
            let (a, b, c) = (turn(0.0), turn(-0.5), turn(0.0));
            let (length, thick) = (self.arm[0], self.arm[1]);
            let shoulder = [side * 0.85 * w, 0.0, 0.85 * self.trunk];
            let upper = toward(outward + side * a, b);
            let lower = toward(outward + side * (a + 0.6 * bend * c.abs()), b + 0.8 * c);
            let arm = chain(shoulder, &[(0.5 * length, upper), (0.45 * length, lower)]);
            body.limb(&arm, thick, 0.75 * thick);
            body.egg(arm[2], [1.2 * thick; 3]);
            let (length, thick) = (self.leg[0], self.leg[1]);
            let (front, apart, knee) = (turn(0.0), 0.15 + 0.3 * turn(0.0).abs(), turn(0.0).abs());
            let down = |front: f64| [side * apart.sin(), front.sin(), -front.cos()];
            let hip = [side * 0.5 * w, 0.0, 0.05 * self.trunk];
            let leg = chain(hip, &[(0.5 * length, down(0.7 * front)), (0.48 * length, down(0.7 * front - knee))]);
            body.limb(&leg, thick, 0.7 * thick);
            body.cone(leg[2], add(leg[2], [0.0, 1.8 * thick, -0.2 * thick]), 0.75 * thick, 0.6 * thick);
        }
        body
    }
}

pub fn human(random: &mut Random) -> Body {
    let stout = between(random, 0.85, 1.2);
    let figure = Figure {
        trunk: between(random, 0.9, 1.1),
        width: 0.3 * stout,
        head: between(random, 0.17, 0.21),
        arm: [between(random, 1.0, 1.2), 0.075 * stout],
        leg: [between(random, 1.2, 1.45), 0.11 * stout],
    };
    let mut body = figure.body(random, 0.9);
    body.blend = 0.08;
    body
}

pub fn armadillo(random: &mut Random) -> Body {
    let figure = Figure {
        trunk: between(random, 0.85, 1.0),
        width: between(random, 0.42, 0.5),
        head: between(random, 0.2, 0.25),
        arm: [between(random, 0.95, 1.1), between(random, 0.11, 0.13)],
        leg: [between(random, 0.95, 1.1), between(random, 0.16, 0.19)],
    };
    let mut body = figure.body(random, 0.7);
    let top = figure.trunk + 2.0 * figure.head;
    for side in [-1.0, 1.0] {
        body.cone([side * 0.15, 0.0, top - 0.05], [side * 0.32, -0.05, top + 0.25], 0.07, 0.03);
    }
    // The snout, and a tail.
    body.cone([0.0, 0.1, top - 0.2], [0.0, 0.38, top - 0.28], 0.12, 0.07);
    let sway = random.signed();
    let tail =
        chain([0.0, -0.25, 0.1], &[(0.4, toward(-1.57 + 0.3 * sway, -0.6)), (0.4, toward(-1.57 + 0.8 * sway, -0.2))]);
    body.limb(&tail, 0.12, 0.04);
    body
}

pub fn teddy(random: &mut Random) -> Body {
    let stout = between(random, 0.9, 1.1);
    let mut body = Body { blend: 0.12, ..Body::default() };
    body.egg([0.0, 0.0, 0.0], [0.55 * stout, 0.5 * stout, 0.62]);
    let head = [0.0, 0.05, between(random, 0.85, 0.95)];
    let size = between(random, 0.36, 0.44);
    body.egg(head, [1.05 * size, 0.95 * size, size]);
    body.egg(add(head, [0.0, 0.9 * size, -0.1]), [0.4 * size, 0.35 * size, 0.3 * size]);
    for side in [-1.0, 1.0] {
        body.egg(add(head, [side * 0.8 * size, 0.0, 0.8 * size]), [0.42 * size, 0.2 * size, 0.42 * size]);
        let (raise, front) = (0.8 * random.signed(), 0.6 * random.unit());
        let arm = add([side * 0.45, 0.0, 0.3], [side * 0.42 * raise.cos(), 0.4 * front, 0.42 * raise.sin()]);
        body.cone([side * 0.4, 0.0, 0.3], arm, 0.19, 0.17);
        let (open, sit) = (0.5 * random.unit(), 1.3 * random.unit());
        let leg = add([side * 0.3, 0.0, -0.4], [side * 0.4 * open, 0.55 * sit.sin(), -0.55 * sit.cos()]);
        body.cone([side * 0.3, 0.0, -0.4], leg, 0.22, 0.2);
    }
    body
}

pub fn fourleg(random: &mut Random) -> Body {
    let mut body = Body { blend: 0.1, ..Body::default() };
    let (long, thick) = (between(random, 0.9, 1.3), between(random, 0.24, 0.36));
    let height = between(random, 0.6, 1.1);
    body.cone([0.0, -0.5 * long, 0.0], [0.0, 0.5 * long, 0.05], thick, 0.95 * thick);
    let raise = between(random, 0.2, 1.2);
    let neck = between(random, 0.35, 0.6);
    let sway = 0.5 * random.signed();
    let up = toward(1.57 + 0.5 * sway, raise);
    let spine = chain([0.0, 0.5 * long, 0.1], &[(neck, up), (0.3, toward(1.57 + sway, -0.3))]);
    body.limb(&spine, 0.6 * thick, 0.12);
    body.egg(spine[1], [0.16, 0.18, 0.16]);
    for side in [-1.0, 1.0] {
        body.cone(add(spine[1], [side * 0.08, 0.0, 0.1]), add(spine[1], [side * 0.15, -0.02, 0.28]), 0.05, 0.03);
        for end in [-1.0, 1.0] {
            let (swing, knee) = (0.6 * random.signed(), -0.5 * random.unit());
            let down = |a: f64| [0.05 * side, a.sin(), -a.cos()];
            let hip = [side * 0.65 * thick, end * 0.45 * long, -0.3 * thick];
            let leg = chain(hip, &[(0.5 * height, down(swing)), (0.5 * height, down(swing + end * knee))]);
            body.limb(&leg, 0.42 * thick, 0.07);
        }
    }
    let (lift, wag) = (random.signed(), random.signed());
    let tail = chain(
        [0.0, -0.5 * long - 0.5 * thick, 0.1],
        &[(0.3, toward(-1.57 + 0.4 * wag, 0.5 * lift)), (0.35, toward(-1.57 + 0.8 * wag, lift - 0.5))],
    );
    body.limb(&tail, 0.08, 0.04);
    body
}

pub fn ant(random: &mut Random) -> Body {
    let mut body = Body { blend: 0.06, ..Body::default() };
    let size = between(random, 0.85, 1.2);
    body.egg([0.0, 0.55, 0.05], [0.2, 0.24, 0.18]);
    body.egg([0.0, 0.05, 0.0], [0.15, 0.25, 0.14]);
    body.egg([0.0, -0.65, 0.05], [0.28 * size, 0.42 * size, 0.26 * size]);
    body.cone([0.0, 0.5, 0.0], [0.0, -0.4, 0.0], 0.07, 0.07);
    for side in [-1.0, 1.0] {
        let outward = |a: f64| if side > 0.0 { a } else { std::f64::consts::PI - a };
        for (i, base) in [0.8, 0.0, -0.8].into_iter().enumerate() {
            let a = outward(base + 0.35 * random.signed());
            let root = [side * 0.1, 0.15 - 0.12 * i as f64, 0.0];
            let lift = between(random, 0.3, 0.9);
            let leg = chain(root, &[(0.42, toward(a, lift)), (0.55, toward(a, -0.9 + 0.3 * random.signed()))]);
            body.limb(&leg, 0.05, 0.035);
        }
        let a = outward(1.1 + 0.3 * random.signed());
        let feeler = chain([side * 0.08, 0.72, 0.15], &[(0.25, toward(a, 0.6)), (0.3, toward(a, 0.1))]);
        body.limb(&feeler, 0.04, 0.03);
    }
    body
}

pub fn octopus(random: &mut Random) -> Body {
    let mut body = Body { blend: 0.1, ..Body::default() };
    let size = between(random, 0.32, 0.5);
    body.egg([0.0, 0.0, 0.35], [size, size, between(random, 0.4, 0.65)]);
    let length = between(random, 0.9, 1.4);
    for i in 0..8 {
        let mut round = f64::from(i) * std::f64::consts::TAU / 8.0 + 0.15 * random.signed();
        let (mut up, curl, side) = (-0.4 + 0.3 * random.signed(), 0.7 * random.signed(), 0.5 * random.signed());
        let mut parts = Vec::new();
        for _ in 0..4 {
            parts.push((0.25 * length, toward(round, up)));
            (round, up) = (round + side, up + curl);
        }
        let start = [0.5 * size * round.cos(), 0.5 * size * round.sin(), 0.0];
        body.limb(&chain(start, &parts), 0.13, 0.04);
    }
    body
}

pub fn hand(random: &mut Random) -> Body {
    let mut body = Body { blend: 0.07, ..Body::default() };
    body.block([0.0, 0.0, 0.0], [0.4, 0.13, 0.45], 0.12);
    body.cone([0.0, 0.0, -0.3], [0.0, 0.0, -0.85], 0.22, 0.2);
    let thick = between(random, 0.085, 0.11);
    let fist = 0.9 * random.unit();
    for (i, length) in [0.62, 0.75, 0.7, 0.52].into_iter().enumerate() {
        let x = -0.3 + 0.2 * i as f64;
        let bend = fist + 0.5 * random.signed();
        let spread = 0.12 * (i as f64 - 1.5) + 0.06 * random.signed();
        let toward = |a: f64| [spread, a.sin(), a.cos()];
        let parts =
            [(0.42 * length, toward(0.5 * bend)), (0.32 * length, toward(bend)), (0.26 * length, toward(1.5 * bend))];
        body.limb(&chain([x, 0.0, 0.4], &parts), thick, 0.8 * thick);
    }
    let (open, bend) = (between(random, 0.5, 1.1), 0.6 * random.signed());
    let thumb = [(0.35, [-open.sin(), 0.2, open.cos()]), (0.3, [-(open - bend).sin(), 0.2, (open - bend).cos()])];
    body.limb(&chain([-0.32, 0.0, -0.2], &thumb), 1.2 * thick, 0.9 * thick);
    body
}

pub fn fish(random: &mut Random) -> Body {
    let mut body = Body { blend: 0.06, ..Body::default() };
    let (deep, wide) = (between(random, 0.28, 0.5), between(random, 0.14, 0.22));
    let swim = 0.35 * random.signed();
    // The trunk as a row of flat eggs along a curve.
    for i in 0..6 {
        let t = f64::from(i) / 5.0;
        let fat = (1.0 - (t - 0.4).powi(2) * 2.0).max(0.25);
        let x = swim * (2.0 * t).sin();
        body.egg([x, 1.6 * t, 0.0], [wide * fat, 0.3, deep * fat]);
    }
    let tail = [swim * 2f64.sin(), 1.65, 0.0];
    let (fork, size) = (between(random, 0.3, 0.8), between(random, 0.4, 0.6));
    for side in [-1.0, 1.0] {
        let tip = add(tail, [0.5 * swim, 0.45, side * fork * size]);
        body.cone(tail, tip, 0.07, 0.05);
        let fin = [side * (wide + 0.25), 0.8, -0.2];
        body.cone([side * 0.6 * wide, 0.5, -0.1], fin, 0.06, 0.035);
    }
    let back = between(random, 0.1, 0.3);
    body.cone([0.0, 0.5, deep * 0.8], [0.0, 1.0, deep + back], 0.06, 0.04);
    body
}

pub fn bird(random: &mut Random) -> Body {
    let mut body = Body { blend: 0.08, ..Body::default() };
    let fat = between(random, 0.17, 0.27);
    body.cone([0.0, -0.3, 0.0], [0.0, 0.35, 0.06], 0.8 * fat, fat);
    let head = [0.15 * random.signed(), between(random, 0.65, 0.95), between(random, 0.15, 0.4)];
    body.cone([0.0, 0.35, 0.05], head, 0.6 * fat, 0.13);
    body.egg(head, [0.13, 0.15, 0.13]);
    body.cone(head, add(head, [0.0, 0.3, -0.03]), 0.06, 0.025);
    let (flap, fold, span) = (0.6 * random.signed(), 0.7 * random.unit(), between(random, 0.9, 1.4));
    for side in [-1.0, 1.0] {
        let root = [side * 0.15, 0.15, 0.1];
        let out = |up: f64, back: f64| [side * up.cos() * back.cos(), -back.sin(), up.sin()];
        let wing = chain(root, &[(0.45 * span, out(flap, 0.1)), (0.55 * span, out(-0.4 * flap, fold))]);
        for back in [0.0, 0.12, 0.24] {
            let shifted: Vec<[f64; 3]> = wing.iter().map(|p| add(*p, [0.0, -back, 0.0])).collect();
            body.limb(&shifted, 0.065, 0.045);
        }
        body.cone([side * 0.07, -0.55, 0.0], [side * 0.14, -0.9, 0.0], 0.06, 0.05);
    }
    body.cone([0.0, -0.3, 0.0], [0.0, -0.85, 0.0], 0.12, 0.06);
    body
}

pub fn bust(random: &mut Random) -> Body {
    let mut body = Body { blend: 0.15, ..Body::default() };
    let wide = between(random, 0.5, 0.85);
    body.egg([0.0, 0.0, 0.0], [wide, 0.33, 0.35]);
    body.cone([0.0, 0.0, 0.2], [0.0, 0.05, 0.65], 0.19, 0.17);
    let head = [0.1 * random.signed(), 0.08, between(random, 0.9, 1.0)];
    body.egg(head, [0.28, 0.33, 0.38]);
    body.cone(add(head, [0.0, 0.3, -0.02]), add(head, [0.0, 0.4, -0.1]), 0.04, 0.05);
    for side in [-1.0, 1.0] {
        body.egg(add(head, [side * 0.28, 0.0, 0.0]), [0.04, 0.07, 0.1]);
    }
    if random.unit() < 0.5 {
        body.egg(add(head, [0.0, -0.1, 0.12]), [0.36, 0.36, 0.36]);
    }
    let base = between(random, 0.2, 0.4);
    body.can([0.0, 0.0, -0.3 - base], [0.0, 0.0, 1.0], between(random, 0.25, 0.4), base);
    body
}
