//! What a wire means: the node that a name stands for, through subgraph calls and inputs.

use std::collections::BTreeSet;

use super::axes::Along;
use super::flatten::{Entry, Walk};
use super::syntax::{Call, Name, Value};
use crate::diagnostics::suggest;

/// A wire as written.
struct Expr {
    name: Name,
    role: Option<Name>,
    all: bool,
}

/// What a wire comes from.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Index in the flat list.
    pub flat: usize,
    /// The pair axis of a wire with `@`, and which of the two.
    pub role: Option<(usize, usize)>,
    /// Whether all instances are gathered.
    pub all: bool,
}

/// Names looked up, with what was used on the way.
#[derive(Default)]
pub struct Used {
    /// Inputs that something is wired to: (scope, input).
    pub inputs: BTreeSet<(usize, usize)>,
    /// Inputs whose wire is wrong, which has been reported.
    pub broken: BTreeSet<(usize, usize)>,
    /// Scopes with a wire that is wrong, which may have been meant for an input.
    pub torn: BTreeSet<usize>,
}

impl Walk<'_, '_> {
    /// What is wired by a value, read in a scope. `None` if there is an error, which is reported.
    pub fn target(&mut self, used: &mut Used, scope: usize, value: &Value) -> Option<Target> {
        let target = self.target_within(used, scope, value, 0);
        if target.is_none() {
            used.torn.insert(scope);
        }
        target
    }

    fn target_within(&mut self, used: &mut Used, scope: usize, value: &Value, depth: usize) -> Option<Target> {
        // Inputs that are wired to outputs of the same call lead nowhere.
        if depth > 256 {
            self.report.error(value.span, "cycle", "this wire leads back to itself");
            return None;
        }
        let expr = self.expr(value)?;
        let inner = self.named(used, scope, &expr.name, &expr.name.text, depth)?;
        let role = match &expr.role {
            Some(role) => Some(self.role(scope, role)?),
            None => None,
        };
        let twice = (inner.all || inner.role.is_some()) && role.is_some() || inner.all && expr.all;
        if twice || (role.is_some() && expr.all) || (inner.role.is_some() && expr.all) {
            self.report
                .error(value.span, "bad-wire", "this picks instances that are picked already")
                .hint("`all(..)` and `@` cannot be combined");
            return None;
        }
        Some(Target { role: role.or(inner.role), all: expr.all || inner.all, ..inner })
    }

    fn expr(&mut self, value: &Value) -> Option<Expr> {
        const HINT: &str = "write the name of a node: `\"mesh\"`, `\"mesh@query\"` or `all(\"mesh\")`";
        let (name, all) = match value.word(self.report, "all") {
            Some(Ok(name)) => (Some(name), true),
            Some(Err(_)) => (None, true),
            None => (value.string(self.report), false),
        };
        let Some(name) = name else {
            let what = match value.call(self.report) {
                Some(Call::Positional(name, _)) if name.text == "param" => "a param cannot be wired to a port",
                Some(Call::Positional(name, _)) if name.text == "each" => "an axis cannot be wired to a port",
                _ => "a port is wired to a node",
            };
            self.report.error(value.span, "bad-wire", what).hint(HINT);
            return None;
        };
        // Without escapes the text begins one byte after the opening quotation mark.
        let written = self.report.sources.text(name.span);
        let plain = written.len() == name.text.len() + 2;
        let span = name.span;
        let part = |range: std::ops::Range<usize>| {
            if plain { span.part(&(range.start + 1..range.end + 1)) } else { span }
        };
        Some(match name.text.split_once('@') {
            Some((node, role)) => {
                let role_span = part(node.len() + 1..name.text.len());
                Expr {
                    name: Name { text: node.to_owned(), span: part(0..node.len()) },
                    role: Some(Name { text: role.to_owned(), span: role_span }),
                    all,
                }
            }
            None => Expr { name, role: None, all },
        })
    }

    /// The node that a path such as `mesh`, `fa` or `fa/basis` names in a scope.
    fn named(&mut self, used: &mut Used, scope: usize, at: &Name, path: &str, depth: usize) -> Option<Target> {
        if depth > 256 {
            self.report.error(at.span, "cycle", "this wire leads back to itself");
            return None;
        }
        let (head, rest) = match path.split_once('/') {
            Some((head, rest)) => (head, Some(rest)),
            None => (path, None),
        };
        match (self.scopes[scope].names.get(head).copied(), rest) {
            (Some(Entry::Node(flat)), None) => Some(Target { flat, role: None, all: false }),
            (Some(Entry::Call(inner)), Some(rest)) => self.named(used, inner, at, rest, depth + 1),
            (Some(Entry::Call(inner)), None) => {
                let output = self.scopes[inner].file.output.clone()?;
                self.named(used, inner, &output, &output.text, depth + 1)
            }
            (Some(Entry::Input(i)), None) => {
                used.inputs.insert((scope, i));
                if used.broken.contains(&(scope, i)) {
                    return None;
                }
                // A missing one has been reported at the call, or with the root's inputs.
                let value = self.scopes[scope].inputs.get(i).cloned().flatten()?;
                let parent = self.scopes[scope].parent;
                self.target_within(used, parent, &value, depth + 1)
            }
            (Some(Entry::Broken), _) => None,
            (None | Some(_), _) => {
                let known: Vec<&str> = self.scopes[scope].names.keys().map(String::as_str).collect();
                let hint = suggest(head, "nodes", &known);
                let message = format!("there is no node `{path}`");
                self.report.error(at.span, "unknown-node", message).hint(hint);
                None
            }
        }
    }

    fn role(&mut self, scope: usize, role: &Name) -> Option<(usize, usize)> {
        let mut found = Vec::new();
        let mut known = Vec::new();
        for axis in self.scopes[scope].axes.values() {
            if let Along::Pairs { roles, .. } = &self.axes[*axis].along {
                known.extend(roles.iter().map(String::as_str));
                found.extend(roles.iter().position(|r| *r == role.text).map(|side| (*axis, side)));
            }
        }
        match found.as_slice() {
            [one] => Some(*one),
            // An axis with an error of its own may have had this name.
            [] if self.holes => None,
            [] => {
                let hint = suggest(&role.text, "sides of pairs", &known);
                let message = format!("no axis of pairs calls a side `{}`", role.text);
                self.report.error(role.span, "unknown-axis", message).hint(hint);
                None
            }
            _ => {
                let message = format!("two axes of pairs call a side `{}`", role.text);
                self.report.error(role.span, "duplicate", message);
                None
            }
        }
    }

    /// The call or node at an address such as `fa` or `fa/basis`, from the root.
    pub fn at_address(&mut self, used: &mut Used, name: &Name, address: &str) -> Option<usize> {
        self.named(used, 0, name, address, 0).map(|target| target.flat)
    }

    /// Reports a name that means nothing in a scope.
    pub fn check_name(&mut self, used: &mut Used, scope: usize, name: &Name) {
        self.named(used, scope, name, &name.text, 0);
    }
}
