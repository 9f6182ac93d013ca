//! What is wrong with a graph: collected all at once, each with its place in the text and a hint.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use miette::{GraphicalReportHandler, GraphicalTheme, LabeledSpan, NamedSource, Severity};
use serde_json::{Value, json};

/// A place in one of the [`Sources`]: bytes `start..end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Span {
    pub(crate) source: usize,
    pub(crate) start: usize,
    pub(crate) end: usize,
}

impl Span {
    /// The place of `range`, counted from the start of this span and kept within it.
    pub(crate) fn part(self, range: &Range<usize>) -> Self {
        let start = (self.start + range.start).min(self.end);
        Self { source: self.source, start, end: (self.start + range.end).clamp(start, self.end) }
    }
}

/// A documentation up to its first full stop before a capital letter: `eq. 10` goes on.
pub(crate) fn first_sentence(doc: &str) -> String {
    let doc = doc.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut stops = doc.match_indices(". ");
    let end = stops.find(|(at, _)| doc[at + 2..].starts_with(char::is_uppercase));
    end.map_or_else(|| doc.clone(), |(at, _)| doc[..=at].to_owned())
}

/// A text that diagnostics point into.
#[derive(Clone, Debug)]
struct Source {
    name: String,
    text: Arc<str>,
}

/// The texts that a plan is made from: graph files and the texts of `--set` and `--variant`.
#[derive(Clone, Debug, Default)]
pub struct Sources(Vec<Source>);

impl Sources {
    /// Adds a text and returns the span of all of it.
    pub(crate) fn add(&mut self, name: String, text: &str) -> Span {
        self.0.push(Source { name, text: text.into() });
        Span { source: self.0.len() - 1, start: 0, end: text.len() }
    }

    /// The text at a span.
    pub(crate) fn text(&self, span: Span) -> &str {
        self.0.get(span.source).and_then(|s| s.text.get(span.start..span.end)).unwrap_or_default()
    }
}

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// What sort of mistake it is, a stable word such as `unknown-kind`.
    pub code: &'static str,
    /// What is wrong, one sentence.
    pub message: String,
    /// What to do about it.
    pub hint: Option<String>,
    /// Where.
    pub span: Span,
}

impl Diagnostic {
    /// Adds what to do about it.
    pub(crate) fn hint(&mut self, hint: impl Into<String>) -> &mut Self {
        self.hint = Some(hint.into());
        self
    }
}

/// All that is wrong, in the order of the texts.
#[derive(Clone, Debug, Default)]
pub struct Diagnostics {
    pub(crate) sources: Sources,
    pub(crate) list: Vec<Diagnostic>,
}

impl Diagnostics {
    /// Adds an error; add a hint to what is returned.
    pub(crate) fn error(&mut self, span: Span, code: &'static str, message: impl Into<String>) -> &mut Diagnostic {
        self.list.push(Diagnostic { code, message: message.into(), hint: None, span });
        let last = self.list.len() - 1;
        &mut self.list[last]
    }

    /// Orders by place and drops repetitions: a subgraph called twice is wrong once.
    pub(crate) fn tidy(&mut self) {
        self.list.sort_by(|a, b| (a.span, &a.message).cmp(&(b.span, &b.message)));
        self.list.dedup_by(|a, b| (a.span, &a.message) == (b.span, &b.message));
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The diagnostics in the order of the texts.
    pub fn iter(&self) -> impl Iterator<Item = &Diagnostic> {
        self.list.iter()
    }

    /// The text that a diagnostic points at.
    #[must_use]
    pub fn text(&self, diagnostic: &Diagnostic) -> &str {
        self.sources.text(diagnostic.span)
    }

    /// The file (or `--set`) that a diagnostic points into.
    #[must_use]
    pub fn file(&self, diagnostic: &Diagnostic) -> &str {
        self.sources.0.get(diagnostic.span.source).map_or("", |s| s.name.as_str())
    }

    /// Line and column where a diagnostic begins, both from 1; the column counts characters.
    #[must_use]
    pub fn position(&self, diagnostic: &Diagnostic) -> (usize, usize) {
        let Span { source, start, .. } = diagnostic.span;
        let before = self.sources.text(Span { source, start: 0, end: start });
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().map_or(0, |last| last.chars().count()) + 1;
        (line, column)
    }

    /// A JSON array of objects with the keys `file`, `start` and `end` (bytes), `line` and `column`
    /// (from 1), `code`, `message` and `hint` (text or null).
    #[must_use]
    pub fn json(&self) -> Value {
        let one = |d: &Diagnostic| {
            let (line, column) = self.position(d);
            json!({
                "file": self.file(d), "start": d.span.start, "end": d.span.end,
                "line": line, "column": column,
                "code": d.code, "message": d.message, "hint": d.hint,
            })
        };
        self.list.iter().map(one).collect()
    }

    /// For a person at a terminal: each with its piece of text, `color` says whether with escapes.
    #[must_use]
    pub fn render(&self, color: bool) -> String {
        let theme = if color { GraphicalTheme::unicode() } else { GraphicalTheme::unicode_nocolor() };
        let handler = GraphicalReportHandler::new_themed(theme).with_links(false).with_width(100);
        let mut out = String::new();
        for diagnostic in &self.list {
            let text = self.sources.0.get(diagnostic.span.source).map(|s| s.text.clone());
            let report =
                Shown { diagnostic, source: NamedSource::new(self.file(diagnostic), text.unwrap_or_default()) };
            if handler.render_report(&mut out, &report).is_err() {
                out.push_str(&diagnostic.message);
            }
            out.push('\n');
        }
        out
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl std::error::Error for Diagnostics {}

/// A diagnostic with its text, as miette shows it.
#[derive(Debug)]
struct Shown<'a> {
    diagnostic: &'a Diagnostic,
    source: NamedSource<Arc<str>>,
}

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.diagnostic.message)
    }
}

impl std::error::Error for Shown<'_> {}

impl miette::Diagnostic for Shown<'_> {
    fn code<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        Some(Box::new(self.diagnostic.code))
    }
    fn severity(&self) -> Option<Severity> {
        Some(Severity::Error)
    }
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.diagnostic.hint.as_ref().map(|hint| Box::new(hint) as Box<dyn fmt::Display>)
    }
    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        Some(&self.source)
    }
    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let Span { start, end, .. } = self.diagnostic.span;
        Some(Box::new(std::iter::once(LabeledSpan::underline(start..end))))
    }
}

/// "did you mean" the candidate most like `word`, if one is like it.
pub(crate) fn did_you_mean<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(word, candidates).map(|best| format!("did you mean `{best}`?"))
}

/// The candidate most like `word`, if one is like it.
fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = word.to_lowercase();
    let mut best: Option<(f64, &str)> = None;
    for candidate in candidates {
        let other = candidate.to_lowercase();
        let mut score = strsim::jaro_winkler(&lower, &other);
        // Two letters swapped in a short name are far apart by that measure.
        if lower.len() > 2 && strsim::damerau_levenshtein(&lower, &other) == 1 {
            score = score.max(0.9);
        }
        if score > 0.75 && best.is_none_or(|(most, _)| score > most) {
            best = Some((score, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

/// "did you mean" the nearest candidate, or else all of them.
pub(crate) fn suggest<'a>(word: &str, what: &str, candidates: &[&'a str]) -> String {
    if let Some(hint) = did_you_mean(word, candidates.iter().copied()) {
        return hint;
    }
    let quoted = |names: &[&'a str]| names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    match candidates {
        [] => format!("there are no {what} here"),
        [..] if candidates.len() > 12 => {
            format!("the {what} are {} and {} more", quoted(&candidates[..12]), candidates.len() - 12)
        }
        _ => format!("the {what} are {}", quoted(candidates)),
    }
}
