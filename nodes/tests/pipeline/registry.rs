//! What holds for every node.

use std::collections::BTreeSet;

use salient_nodes::NODES;
use salient_sdk::{AnyNode, Registry};

#[test]
fn kinds_are_unique_snake_case_and_documented() {
    let registry = Registry::new(&[NODES]).unwrap();
    for node in registry.iter() {
        let kind = node.kind();
        assert!(kind.chars().all(|c| c.is_ascii_lowercase() || c == '_' || c.is_ascii_digit()), "{kind}");
        assert!(node.version() >= 1);
        assert!(node.doc().ends_with('.') && node.doc().len() > 30, "{kind} has no documentation");
        assert!(node.example().contains(&format!("{kind}(")), "the example of {kind} does not use it");
    }
}

#[test]
fn the_list_is_in_alphabetical_order() {
    let kinds: Vec<_> = NODES.iter().map(|n| n.kind()).collect();
    assert!(kinds.is_sorted(), "{kinds:?}");
}

#[test]
fn ports_and_params_are_documented_and_do_not_collide() {
    for node in NODES {
        let mut names = BTreeSet::new();
        for port in node.ports() {
            assert!(names.insert(port.name.to_owned()), "{}: `{}` twice", node.kind(), port.name);
            assert!(!port.doc.is_empty(), "{}: port `{}`", node.kind(), port.name);
        }
        for param in AnyNode::params(*node) {
            assert!(names.insert(param.name.clone()), "{}: `{}` twice", node.kind(), param.name);
            assert!(param.doc.len() > 15, "{}: param `{}` says nothing", node.kind(), param.name);
            assert_ne!(param.form, "any", "{}: param `{}` has no form", node.kind(), param.name);
        }
    }
}

#[test]
fn one_type_has_one_format_and_documentation() {
    let mut formats = std::collections::BTreeMap::new();
    for node in NODES {
        let output = node.output();
        assert!(output.doc.len() > 20, "{}", output.name);
        assert_eq!(*formats.entry(output.name).or_insert(output.format), output.format);
    }
}

#[test]
fn unknown_params_are_refused_by_every_node() {
    for node in NODES {
        let errors = node.bind(&[("no_such_param", "1")]).err();
        assert!(errors.is_some(), "{}", node.kind());
    }
}
