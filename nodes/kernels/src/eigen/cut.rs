//! Where a cut above the wanted eigenvalues can be placed.

/// A gap this wide, relative to the eigenvalue above it, is as good a place for the cut as any.
const WIDE: f64 = 1e-4;

/// A gap must be at least this wide for a cut.
const NARROW: f64 = 1e-8;

/// A place in a gap of the spectrum, above the first `position` values; `width` is the gap's, relative to the value above.
pub(super) struct Cut {
    pub position: usize,
    pub value: f64,
    pub width: f64,
}

/// The first wide gap above the wanted pairs, else the widest there is, else, if the values are all there are, the end; else nothing.
pub(super) fn place_cut(values: &[f64], wanted: usize, available: usize) -> Option<Cut> {
    if values.len() < wanted {
        return None;
    }
    let mut best: Option<Cut> = None;
    for position in wanted..values.len() {
        let below = if position == 0 { 0.0 } else { values[position - 1] };
        let above = values[position];
        let width = (above - below) / above;
        if width > best.as_ref().map_or(NARROW, |b| b.width) {
            best = Some(Cut { position, value: 0.5 * (below + above), width });
        }
        if width > WIDE {
            break;
        }
    }
    // No gap, but nothing above either: any cut above the last.
    let all = values.len() == available;
    let above_all = || Cut { position: available, value: 2.0 * values.last().copied().unwrap_or(1.0), width: 0.5 };
    best.or_else(|| all.then(above_all))
}
