//! Typed params: each distinct set of texts is parsed once.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

use salient_sdk::{BoundNode, ParamError};

use super::axes::{Along, Axis, Item, folders};
use super::file::tidy;
use super::flatten::{Arg, Flat, Kind};
use super::syntax::string;
use crate::diagnostics::{Diagnostics, Span, did_you_mean, first_sentence};

/// Params of one call, typed.
pub struct Bound {
    pub node: Arc<dyn BoundNode>,
    pub files: BTreeMap<String, PathBuf>,
}

/// A param's text with its place.
#[derive(Clone)]
pub struct Text {
    pub name: String,
    pub ron: Rc<str>,
    pub span: Span,
    /// Whether `text` is what is written at `span`.
    pub exact: bool,
    pub dir: Rc<Path>,
}

/// Params as written: kind, then names, texts and folders.
type Written = (&'static str, Vec<(String, Rc<str>, Rc<Path>)>);

/// All params bound so far; equal ones have equal numbers.
#[derive(Default)]
pub struct Binder {
    pub bounds: Vec<Bound>,
    by_text: HashMap<Written, usize>,
    by_value: HashMap<(&'static str, String), usize>,
    /// Whether each input file was there.
    pub exists: HashMap<PathBuf, bool>,
}

/// The params of a node; `item` is where it is on its axis.
pub fn texts(report: &Diagnostics, params: &[(String, Arg)], axes: &[Axis], item: usize) -> Vec<Text> {
    let text = |(name, arg): &(String, Arg)| match arg {
        Arg::Text(value) => Some(Text {
            name: name.clone(),
            ron: report.sources.text(value.span).into(),
            span: value.span,
            exact: true,
            dir: value.dir.clone(),
        }),
        Arg::Each(axis, _) => match &axes[*axis].along {
            Along::Items(items) => {
                let Item { text, span, dir, exact, .. } = items.get(item)?.clone();
                Some(Text { name: name.clone(), ron: text, span, exact, dir })
            }
            Along::Pairs { .. } => None,
        },
        Arg::Folders(axis, span) => Some(Text {
            name: name.clone(),
            ron: folders(axes, *axis).into(),
            span: *span,
            exact: false,
            dir: Path::new("").into(),
        }),
        Arg::Broken => None,
    };
    params.iter().filter_map(text).collect()
}

impl Binder {
    /// The number of the bound params, or `None` if they are wrong, which is reported.
    pub fn bind(&mut self, report: &mut Diagnostics, flat: &Flat, texts: &[Text]) -> Option<usize> {
        let kind = flat.kind.node.kind();
        let part = |t: &Text| (t.name.clone(), t.ron.clone(), t.dir.clone());
        let key = (kind, texts.iter().map(part).collect());
        if let Some(known) = self.by_text.get(&key) {
            return Some(*known);
        }
        // Wrong ones are not kept: the same text may be wrong in several places.
        let found = self.bind_new(report, flat, texts)?;
        self.by_text.insert(key, found);
        Some(found)
    }

    fn bind_new(&mut self, report: &mut Diagnostics, flat: &Flat, texts: &[Text]) -> Option<usize> {
        let kind = &flat.kind;
        let given = |name: &str| texts.iter().find(|t| t.name == name);
        let is_broken = |name: &str| flat.params.iter().any(|(n, arg)| n == name && matches!(arg, Arg::Broken));
        let broken = flat.params.iter().any(|(_, arg)| matches!(arg, Arg::Broken));
        let lacks = |name: &str| given(name).is_none() && !is_broken(name);
        let missing: Vec<_> = kind.infos.iter().filter(|i| i.default.is_none() && lacks(&i.name)).collect();
        for info in &missing {
            let message = format!("`{}` needs the param `{}`", kind.node.kind(), info.name);
            report.error(flat.span, "missing-param", message).hint(format!(
                "add `{}: ..`: {}, {}",
                info.name,
                info.form,
                first_sentence(&info.doc)
            ));
        }
        let fields: Vec<(&str, &str)> = texts.iter().map(|t| (t.name.as_str(), &*t.ron)).collect();
        let node = match kind.node.bind(&fields) {
            Ok(node) => node,
            Err(errors) => {
                for error in errors {
                    // A missing param fails the whole, without saying more than is said above.
                    if !error.param.is_empty() || (missing.is_empty() && !broken) {
                        explain(report, flat, given(&error.param), &error);
                    }
                }
                let path = |name: &str| given(name).and_then(|t| string(&t.ron));
                self.files(report, flat, path, texts);
                return None;
            }
        };
        let path = |name: &str| node.params()[name].as_str().map(str::to_owned);
        let files = self.files(report, flat, path, texts)?;
        if !missing.is_empty() || broken {
            return None;
        }
        let canonical = canonical(kind, node.as_ref(), &files);
        let next = self.bounds.len();
        let number = *self.by_value.entry((kind.node.kind(), canonical)).or_insert(next);
        if number == next {
            self.bounds.push(Bound { node, files });
        }
        Some(number)
    }

    /// The files that the params name, each of which must exist.
    fn files(
        &mut self,
        report: &mut Diagnostics,
        flat: &Flat,
        path: impl Fn(&str) -> Option<String>,
        texts: &[Text],
    ) -> Option<BTreeMap<String, PathBuf>> {
        let mut files = BTreeMap::new();
        let mut all = true;
        for info in flat.kind.infos.iter().filter(|info| info.file) {
            let Some(path) = path(&info.name) else { continue };
            let text = texts.iter().find(|t| t.name == info.name);
            let full = tidy(&text.map_or(&flat.dir, |t| &t.dir).join(path));
            if !*self.exists.entry(full.clone()).or_insert_with(|| full.is_file()) {
                all = false;
                let (message, hint) = if full.is_dir() {
                    (format!("{} is a folder, not a file", full.display()), Some("name a file in it".into()))
                } else {
                    (format!("the file {} does not exist", full.display()), similar(&full))
                };
                let span = text.map_or(flat.span, |t| t.span);
                let error = report.error(span, "missing-file", message);
                if let Some(hint) = hint {
                    error.hint(hint);
                }
            }
            files.insert(info.name.clone(), full);
        }
        all.then_some(files)
    }
}

/// Params that mean the same give the same text, however they and their files are written.
fn canonical(kind: &Kind, node: &dyn BoundNode, files: &BTreeMap<String, PathBuf>) -> String {
    let mut params = node.params().clone();
    for (name, path) in files {
        if kind.infos.iter().any(|info| info.name == *name) {
            params[name] = path.to_string_lossy().into();
        }
    }
    params.to_string()
}

fn similar(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Some(format!("there is no folder {}", folder.display()));
    };
    let files = entries.filter_map(Result::ok).filter(|e| e.path().is_file());
    let mut names: Vec<String> = files.filter_map(|e| e.file_name().into_string().ok()).collect();
    names.sort();
    did_you_mean(name, names.iter().map(String::as_str))
}

fn explain(report: &mut Diagnostics, flat: &Flat, text: Option<&Text>, error: &ParamError) {
    let kind = &flat.kind;
    let span = match text {
        Some(t) if t.exact && !error.span.is_empty() => t.span.part(&error.span),
        Some(t) => t.span,
        None => flat.span,
    };
    let info = kind.infos.iter().find(|info| info.name == error.param);
    let hint = info.map(|info| {
        let written = text.map_or("", |t| t.ron.trim());
        let word = written.split(['(', '"']).find(|w| !w.is_empty()).unwrap_or_default();
        let choices = info.form.split(" | ").map(|c| c.trim_end_matches("(..)"));
        let is_choice = info.form.contains(" | ");
        let near = if is_choice { did_you_mean(word, choices) } else { None };
        near.unwrap_or_else(|| format!("`{}` ({}): {}", info.name, info.form, first_sentence(&info.doc)))
    });
    let message = match (text, error.span.is_empty()) {
        (Some(_), false) => format!("`{}`: {}", error.param, lower(&error.message)),
        _ => error.message.clone(),
    };
    let error = report.error(span, "bad-param", message);
    if let Some(hint) = hint {
        error.hint(hint);
    }
}

fn lower(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |c| c.to_lowercase().chain(chars).collect())
}
