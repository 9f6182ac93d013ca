//! The census of defects, and the params that mend them.

use salient_sdk::{DefectKind, Mesh};

use super::{defect, load_with};

/// A tetrahedron (vertices 1-4); a triangle (5, 6, 7) apart, whose vertex 5 lies on vertex 1; a face without area; an unused vertex 0.
const MESSY: &str = "v 7 7 7\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 0 0\nv 5 0 0\nv 5 5 0\n\
    f 2 4 3\nf 2 3 5\nf 3 4 5\nf 2 5 4\nf 6 7 8\nf 2 3 3\n";

fn messy(more: &[(&str, &str)]) -> Mesh {
    load_with("a.obj", MESSY.as_bytes(), more).unwrap()
}

fn found(mesh: &Mesh) -> Vec<(DefectKind, usize, Vec<u32>, bool)> {
    mesh.defects.iter().map(|d| (d.kind, d.count, d.first.clone(), d.repaired)).collect()
}

#[test]
fn a_messy_file_loads_as_it_is_and_says_so() {
    let mesh = messy(&[]);
    assert_eq!((mesh.vertices.len(), mesh.faces.len(), &mesh.source), (8, 6, &None));
    assert_eq!(
        found(&mesh),
        [
            (DefectKind::NonManifoldEdge, 1, vec![1, 2], false),
            (DefectKind::ZeroAreaFace, 1, vec![5], false),
            (DefectKind::DuplicateVertex, 1, vec![5], false),
            (DefectKind::UnreferencedVertex, 1, vec![0], false),
            (DefectKind::BoundaryEdge, 3, vec![5, 6, 5, 7, 6, 7], false),
            (DefectKind::SeveralComponents, 1, vec![5], false),
        ]
    );
}

#[test]
fn each_repair_mends_its_defect_and_is_reported() {
    let welded = messy(&[("weld", "Always")]);
    assert_eq!(welded.source.as_deref(), Some(&[0, 1, 2, 3, 4, 6, 7][..]));
    assert_eq!(welded.faces[4], [1, 5, 6]);
    let duplicate = defect(&welded, DefectKind::DuplicateVertex).unwrap();
    assert_eq!((duplicate.count, &duplicate.first[..], duplicate.repaired), (1, &[5][..], true));
    assert!(defect(&welded, DefectKind::SeveralComponents).is_none());
    assert!(!defect(&welded, DefectKind::NonManifoldVertex).unwrap().repaired);

    let flat = messy(&[("drop_degenerate", "true")]);
    assert_eq!((flat.faces.len(), flat.vertices.len(), &flat.source), (5, 8, &None));
    assert!(defect(&flat, DefectKind::ZeroAreaFace).unwrap().repaired);
    assert!(defect(&flat, DefectKind::NonManifoldEdge).is_none());

    let used = messy(&[("drop_unreferenced", "true")]);
    assert_eq!(used.source.as_deref(), Some(&[1, 2, 3, 4, 5, 6, 7][..]));
    assert!(defect(&used, DefectKind::UnreferencedVertex).unwrap().repaired);
}

#[test]
fn all_repairs_leave_a_clean_mesh_that_knows_its_source() {
    let all = ["drop_degenerate", "drop_unreferenced", "largest_component"].map(|p| (p, "true"));
    let mesh = messy(&all);
    assert_eq!(mesh.source.as_deref(), Some(&[1, 2, 3, 4][..]));
    assert_eq!(mesh.faces, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]);
    assert!(mesh.defects.iter().all(|d| d.repaired), "{:?}", mesh.defects);
    assert_eq!(mesh.vertices[1], [1.0, 0.0, 0.0]);
}

#[test]
fn orientation_is_reported_not_mended() {
    let text = "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n3 1 2 3\n";
    let mesh = load_with("a.off", text.as_bytes(), &[]).unwrap();
    let turned = defect(&mesh, DefectKind::InconsistentOrientation).unwrap();
    assert_eq!((turned.count, &turned.first[..], turned.repaired), (1, &[1, 2][..], false));
}

#[test]
fn a_repair_that_leaves_nothing_is_an_error() {
    let text = "OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n";
    assert_eq!(load_with("a.off", text.as_bytes(), &[]).unwrap().faces.len(), 1);
    let error = load_with("a.off", text.as_bytes(), &[("drop_degenerate", "true")]).unwrap_err();
    assert_eq!(error.message, "OFF: no face is left after the repairs");
}

#[test]
fn places_of_repairs_are_numbered_as_in_the_file() {
    // Vertex 4 repeats vertex 0; the second component begins at vertex 5, which welding makes 4; vertex 8 is unused.
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 0 0\nv 5 0 0\nv 5 5 0\nv 5 0 5\nv 9 9 9\n\
        f 1 3 2\nf 5 2 4\nf 2 3 4\nf 1 4 3\nf 6 7 8\n";
    let repairs = [("weld", "Always"), ("largest_component", "true"), ("drop_unreferenced", "true")];
    let mesh = load_with("a.obj", text.as_bytes(), &repairs).unwrap();
    assert_eq!(mesh.source.as_deref(), Some(&[0, 1, 2, 3][..]));
    assert_eq!(
        found(&mesh),
        [(DefectKind::DuplicateVertex, 1, vec![4], true), (DefectKind::SeveralComponents, 1, vec![5], true)]
    );
}
