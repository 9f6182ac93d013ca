//! The plan put together: equal calls on equal inputs become one.

use std::collections::HashMap;

use petgraph::graph::NodeIndex;

use super::axes::{Along, Axis, count, pairs};
use super::bind::Binder;
use super::check::Link;
use super::expand::{Numbers, Variant};
use super::flatten::Flat;
use super::plan::{Call, Plan, Shown, Wire};

/// What makes a call what it is: kind, params and inputs.
#[derive(PartialEq, Eq, Hash)]
struct Identity {
    kind: &'static str,
    params: usize,
    wires: Vec<(usize, NodeIndex, String)>,
}

/// Adds the variants one after the other.
#[derive(Default)]
pub struct Assembly {
    pub plan: Plan,
    known: HashMap<Identity, NodeIndex>,
}

impl Assembly {
    /// Adds a variant without errors.
    pub fn add(&mut self, binder: &Binder, flats: &[Flat], axes: &[Axis], variant: &Variant) {
        let mut calls: Vec<Vec<NodeIndex>> = vec![Vec::new(); flats.len()];
        for flat in &variant.linked.order {
            let axis = variant.linked.axis[*flat];
            let instances = axis.map_or(1, |a| count(axes, a));
            let sides = axis.and_then(|a| sides(axes, a));
            let mut own = Vec::with_capacity(instances);
            for i in 0..instances {
                let pair = sides.as_ref().map(|sides| sides[i]);
                let wires = wires(variant, &calls, &variant.linked.links[*flat], i, pair);
                let params = match &variant.numbers[*flat] {
                    Numbers::One(number) => *number,
                    Numbers::Each(numbers) => numbers[i],
                };
                let label = axis.and_then(|a| variant.labels.get(&a)).map(|l| l[i].as_str());
                let call = self.call(binder, &flats[*flat], params, wires);
                self.name(call, variant, *flat, label);
                own.push(call);
            }
            calls[*flat] = own;
        }
        for show in &variant.show {
            let labels = variant.linked.axis[show.flat].and_then(|a| variant.labels.get(&a));
            for (i, call) in calls[show.flat].iter().enumerate() {
                if show.instance.is_some_and(|wanted| wanted != i) {
                    continue;
                }
                let address = match labels.filter(|_| show.instance.is_none()) {
                    Some(labels) => format!("{}{}[{}]", variant.prefix, show.address, labels[i]),
                    None => format!("{}{}", variant.prefix, show.address),
                };
                self.plan.show.push(Shown { address, call: *call });
            }
        }
    }

    fn call(
        &mut self,
        binder: &Binder,
        flat: &Flat,
        params: usize,
        wires: Vec<(usize, NodeIndex, String)>,
    ) -> NodeIndex {
        let node = flat.kind.node;
        let identity = Identity { kind: node.kind(), params, wires };
        if let Some(known) = self.known.get(&identity) {
            return *known;
        }
        let bound = &binder.bounds[params];
        let call = self.plan.dag.add_node(Call {
            node,
            bound: bound.node.clone(),
            files: bound.files.clone(),
            addresses: Vec::new(),
        });
        for (port, from, label) in &identity.wires {
            let wire = Wire { port: node.ports()[*port].name, label: label.clone() };
            self.plan.dag.add_edge(*from, call, wire);
        }
        self.known.insert(identity, call);
        call
    }

    fn name(&mut self, call: NodeIndex, variant: &Variant, flat: usize, label: Option<&str>) {
        for address in &variant.addresses[flat] {
            let address = match label {
                Some(label) => format!("{}{address}[{label}]", variant.prefix),
                None => format!("{}{address}", variant.prefix),
            };
            self.plan.dag[call].addresses.push(address.clone());
            self.plan.addresses.insert(address, call);
        }
    }
}

/// The two items of each pair, for an axis of pairs.
fn sides(axes: &[Axis], axis: usize) -> Option<Vec<[usize; 2]>> {
    match &axes[axis].along {
        Along::Items(_) => None,
        Along::Pairs { of, .. } => Some(pairs(count(axes, *of)).map(|(i, j)| [i, j]).collect()),
    }
}

fn wires(
    variant: &Variant,
    calls: &[Vec<NodeIndex>],
    links: &[Link],
    instance: usize,
    pair: Option<[usize; 2]>,
) -> Vec<(usize, NodeIndex, String)> {
    let mut wires = Vec::with_capacity(links.len());
    for link in links {
        let source = &calls[link.from.flat];
        let axis = variant.linked.axis[link.from.flat];
        let labels = axis.and_then(|a| variant.labels.get(&a));
        if let (true, Some(labels)) = (link.from.all, labels) {
            let all = source.iter().zip(labels);
            wires.extend(all.map(|(call, label)| (link.port, *call, label.clone())));
            continue;
        }
        let at = match (link.from.role, pair, axis) {
            (Some((_, side)), Some(pair), _) => pair[side],
            (_, _, Some(_)) => instance,
            _ => 0,
        };
        wires.push((link.port, source[at], link.label.clone()));
    }
    wires
}
