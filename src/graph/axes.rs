//! Axes: lists of files or values along which nodes are repeated, and pairs of their items.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use glob::{MatchOptions, Pattern};

use super::file::tidy;
use super::flatten::Walk;
use super::syntax::{Call, Field, Name, Value, string};
use crate::diagnostics::{Diagnostics, Span, suggest};

/// Items that an axis may have.
const MOST_ITEMS: usize = 100_000;

/// One item of an axis.
#[derive(Clone, Debug)]
pub struct Item {
    /// Its name in addresses: `cat0` of `mesh[cat0]`.
    pub label: String,
    /// RON text of its value.
    pub text: Rc<str>,
    /// Where it is written.
    pub span: Span,
    /// The folder that a path is relative to.
    pub dir: Rc<Path>,
    /// Whether `text` is what is written at `span`.
    pub exact: bool,
}

/// What an axis runs over.
#[derive(Clone, Debug)]
pub enum Along {
    /// A list.
    Items(Vec<Item>),
    /// Unordered pairs of the items of another axis, each once.
    Pairs { of: usize, roles: [String; 2] },
}

/// An axis of one scope.
#[derive(Clone, Debug)]
pub struct Axis {
    pub name: String,
    pub span: Span,
    pub along: Along,
}

/// Number of instances of a node on an axis, and their names.
pub fn labels(axes: &[Axis], axis: usize) -> Vec<String> {
    match &axes[axis].along {
        Along::Items(items) => items.iter().map(|i| i.label.clone()).collect(),
        Along::Pairs { of, .. } => {
            let of = labels(axes, *of);
            pairs(of.len()).map(|(i, j)| format!("{},{}", of[i], of[j])).collect()
        }
    }
}

/// How many instances a node on an axis has.
pub fn count(axes: &[Axis], axis: usize) -> usize {
    match &axes[axis].along {
        Along::Items(items) => items.len(),
        Along::Pairs { of, .. } => {
            let n = count(axes, *of);
            n * n.saturating_sub(1) / 2
        }
    }
}

/// The pairs i < j, in order.
pub fn pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |i| (i + 1..n).map(move |j| (i, j)))
}

/// What patterns matched, by folder and pattern.
pub type Found = BTreeMap<(PathBuf, String), Result<Vec<PathBuf>, String>>;

/// Files found by patterns, looked up once each.
#[derive(Default)]
pub struct Globs {
    pub known: Found,
    pub folders: BTreeSet<PathBuf>,
}

impl Globs {
    /// The files that a pattern in a folder matches, in order, relative to the folder.
    fn find(&mut self, dir: &Path, pattern: &str) -> Result<Vec<PathBuf>, String> {
        let key = (dir.to_owned(), pattern.to_owned());
        if let Some(known) = self.known.get(&key) {
            return known.clone();
        }
        let found = look(dir, pattern);
        self.folders.insert(fixed_folder(dir, pattern));
        let files = found.iter().flatten();
        self.folders.extend(files.filter_map(|file| dir.join(file).parent().map(Path::to_owned)));
        self.known.insert(key, found.clone());
        found
    }
}

/// The files that a pattern in a folder matches now, in order, relative to the folder.
pub fn look(dir: &Path, pattern: &str) -> Result<Vec<PathBuf>, String> {
    let (full, absolute) = full_pattern(dir, pattern)?;
    let options = MatchOptions { require_literal_leading_dot: true, ..MatchOptions::new() };
    let paths = glob::glob_with(&full, options).map_err(|e| format!("this is not a pattern of files: {}", e.msg))?;
    let mut files = Vec::new();
    for path in paths {
        let path = path.map_err(|e| format!("cannot list {}: {}", e.path().display(), e.error()))?;
        if !path.is_file() {
            continue;
        }
        let relative = if absolute { Some(path.as_path()) } else { path.strip_prefix(dir).ok() };
        files.push(relative.unwrap_or(&path).to_owned());
        if files.len() > MOST_ITEMS {
            return Err(format!("more than {MOST_ITEMS} files match"));
        }
    }
    files.sort();
    Ok(files)
}

/// A pattern with its folder, and whether what it matches is not relative to that.
fn full_pattern(dir: &Path, pattern: &str) -> Result<(String, bool), String> {
    let Some(folder) = dir.to_str() else {
        return Err(format!("the folder {} is not UTF-8", dir.display()));
    };
    let absolute = Path::new(pattern).is_absolute() || folder.is_empty();
    Ok((if absolute { pattern.to_owned() } else { format!("{}/{pattern}", Pattern::escape(folder)) }, absolute))
}

/// The folders, there or not, in which a new entry could match the pattern or a part of it.
pub fn listed_folders(dir: &Path, pattern: &str) -> Vec<PathBuf> {
    let parts: Vec<&str> = pattern.split('/').collect();
    let fixed = fixed_parts(&parts);
    let mut folders = vec![fixed_folder(dir, pattern)];
    for count in fixed + 1..parts.len() {
        let Ok((full, _)) = full_pattern(dir, &parts[..count].join("/")) else { continue };
        let Ok(paths) = glob::glob(&full) else { continue };
        folders.extend(paths.filter_map(Result::ok).filter(|path| path.is_dir()));
    }
    folders
}

/// How many folders of a pattern come before the first that is not literal.
fn fixed_parts(parts: &[&str]) -> usize {
    let special = |part: &&&str| part.contains(['*', '?', '[']);
    parts.iter().take(parts.len() - 1).take_while(|part| !special(part)).count()
}

/// The folder that holds all matches of a pattern.
fn fixed_folder(dir: &Path, pattern: &str) -> PathBuf {
    let parts: Vec<&str> = pattern.split('/').collect();
    let path = parts[..fixed_parts(&parts)].iter().fold(String::new(), |path, part| path + part + "/");
    tidy(&dir.join(path))
}

impl Walk<'_, '_> {
    /// Adds the axes of a scope.
    pub fn open_axes(&mut self, scope: usize) {
        let file = self.scopes[scope].file.clone();
        let mut later = Vec::new();
        for field in &file.over {
            let Some((inner, value)) = self.follow(scope, &field.value) else {
                self.holes = true;
                continue;
            };
            if let Some(Call::Named(name, args)) = value.call(self.report)
                && name.text == "pairs"
            {
                later.push((field.clone(), inner, value.span, args));
                continue;
            }
            match self.items(&value) {
                Some(items) => self.add_axis(scope, field, Along::Items(items)),
                None => self.holes = true,
            }
        }
        for (field, inner, span, args) in later {
            match self.pair_axis(inner, span, &args) {
                Some(along) => self.add_axis(scope, &field, along),
                None => self.holes = true,
            }
        }
    }

    fn add_axis(&mut self, scope: usize, field: &Field, along: Along) {
        let name = field.name.text.clone();
        self.axes.push(Axis { name: name.clone(), span: field.name.span, along });
        self.scopes[scope].axes.insert(name, self.axes.len() - 1);
    }

    fn items(&mut self, value: &Value) -> Option<Vec<Item>> {
        if let Some(list) = value.list(self.report) {
            return list_items(self.report, value.span, &list);
        }
        match value.call(self.report) {
            Some(Call::Positional(name, args)) if name.text == "files" => self.files(value, &args),
            _ => {
                self.report
                    .error(value.span, "bad-axis", "an axis is a list, `files(..)` or `pairs(..)`")
                    .hint("for example `files(\"shapes/*.off\")` or `[1.0, 1.7]`");
                None
            }
        }
    }

    fn files(&mut self, value: &Value, args: &[Value]) -> Option<Vec<Item>> {
        let mut paths = BTreeSet::new();
        for arg in args {
            let Some(pattern) = arg.string(self.report) else {
                self.report.error(arg.span, "bad-axis", "a pattern of files is expected here");
                return None;
            };
            match self.globs.find(&value.dir, &pattern.text) {
                Ok(found) if !found.is_empty() => paths.extend(found),
                Ok(_) => {
                    self.report
                        .error(arg.span, "no-files", format!("no file matches `{}`", pattern.text))
                        .hint(format!("looked in {}", shown(&fixed_folder(&value.dir, &pattern.text))));
                    return None;
                }
                Err(why) => {
                    self.report.error(arg.span, "bad-axis", why);
                    return None;
                }
            }
        }
        let mut items = Vec::with_capacity(paths.len());
        for path in &paths {
            let (Some(text), Some(stem)) = (path.to_str(), path.file_stem().and_then(|s| s.to_str())) else {
                let message = format!("the file name {} is not UTF-8", path.display());
                self.report.error(value.span, "bad-axis", message);
                return None;
            };
            items.push(Item {
                label: stem.to_owned(),
                text: quoted(text).into(),
                span: value.span,
                dir: value.dir.clone(),
                exact: false,
            });
        }
        name_files(self.report, value.span, &mut items);
        Some(items)
    }

    fn pair_axis(&mut self, scope: usize, span: Span, args: &[Field]) -> Option<Along> {
        const HINT: &str = "for example `pairs(of: \"shape\", as: (\"query\", \"target\"))`";
        let get = |name: &str| args.iter().find(|f| f.name.text == name);
        if let Some(other) = args.iter().find(|f| !matches!(f.name.text.as_str(), "of" | "as")) {
            let message = format!("`pairs` has no field `{}`", other.name.text);
            self.report.error(other.name.span, "unknown-field", message).hint(HINT);
            return None;
        }
        let of = get("of").and_then(|f| f.value.string(self.report));
        let roles: Option<Vec<Name>> = get("as").and_then(|f| f.value.call(self.report)).and_then(|call| match call {
            Call::Positional(name, roles) if name.text.is_empty() => {
                roles.iter().map(|role| role.string(self.report)).collect()
            }
            _ => None,
        });
        let (Some(of), Some([one, two])) = (of, roles.as_deref()) else {
            self.report.error(span, "bad-axis", "`pairs` needs an axis and two names").hint(HINT);
            return None;
        };
        if one.text == two.text {
            self.report.error(two.span, "duplicate", "the two of a pair need different names");
            return None;
        }
        let plain = |axis: &&usize| matches!(self.axes[**axis].along, Along::Items(_));
        let Some(axis) = self.scopes[scope].axes.get(&of.text).filter(plain) else {
            let known: Vec<&str> = self.scopes[scope].axes.keys().map(String::as_str).collect();
            let hint = suggest(&of.text, "axes", &known);
            let message = format!("there is no axis `{}` to make pairs of", of.text);
            // An axis with an error of its own has been reported.
            if !self.scopes[scope].file.over.iter().any(|f| f.name.text == of.text) || hint.contains('?') {
                self.report.error(of.span, "unknown-axis", message).hint(hint);
            }
            return None;
        };
        if count(&self.axes, *axis) < 2 {
            self.report.error(of.span, "bad-axis", "an axis of one item has no pairs");
            return None;
        }
        Some(Along::Pairs { of: *axis, roles: [one.text.clone(), two.text.clone()] })
    }
}

fn shown(folder: &Path) -> String {
    if folder.as_os_str().is_empty() { ".".into() } else { folder.display().to_string() }
}

/// A RON string.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n"))
}

/// Characters with a meaning in addresses.
const RESERVED: [char; 3] = [',', '[', ']'];

fn list_items(report: &mut Diagnostics, span: Span, list: &[Value]) -> Option<Vec<Item>> {
    if list.is_empty() {
        report.error(span, "bad-axis", "an axis needs at least one item");
        return None;
    }
    let item = |(i, value): (usize, &Value)| {
        let text = report.sources.text(value.span);
        let label = match string(text) {
            Some(label) => label,
            None if text.contains(RESERVED) || text.contains('\n') => i.to_string(),
            None => text.to_owned(),
        };
        Item { label, text: text.into(), span: value.span, dir: value.dir.clone(), exact: true }
    };
    let items: Vec<Item> = list.iter().enumerate().map(item).collect();
    let mut seen = BTreeSet::new();
    for item in &items {
        if !seen.insert(&item.label) {
            report.error(item.span, "duplicate", format!("`{}` is on the axis twice", item.label));
        }
        reserved(report, item);
    }
    Some(items)
}

fn reserved(report: &mut Diagnostics, item: &Item) {
    if item.label.contains(RESERVED) {
        let message = format!("`{}` cannot name an instance", item.label);
        report.error(item.span, "bad-name", message).hint("rename it without commas and square brackets");
    }
}

/// RON text of the names of an axis's files, each with the name of the folder that holds it.
pub fn folders(axes: &[Axis], axis: usize) -> String {
    let Along::Items(items) = &axes[axis].along else { return "[]".into() };
    let pair = |item: &Item| {
        let path = item.dir.join(string(&item.text)?);
        let folder = path.parent()?.file_name()?.to_str()?.to_owned();
        Some(format!("({}, {})", quoted(&item.label), quoted(&folder)))
    };
    format!("[{}]", items.iter().filter_map(pair).collect::<Vec<_>>().join(", "))
}

/// Makes the names of files unique by the folder's name, or refuses them.
pub fn name_files(report: &mut Diagnostics, span: Span, items: &mut [Item]) {
    let mut count: BTreeMap<String, usize> = BTreeMap::new();
    for item in &*items {
        *count.entry(item.label.clone()).or_default() += 1;
    }
    for item in &mut *items {
        if count.get(&item.label).is_some_and(|n| *n > 1) {
            let path = string(&item.text).map(|text| item.dir.join(text)).unwrap_or_default();
            if let Some(folder) = path.parent().and_then(Path::file_name) {
                item.label = format!("{}/{}", folder.to_string_lossy(), item.label);
            }
        }
    }
    let mut seen: BTreeMap<&str, &Item> = BTreeMap::new();
    for item in &*items {
        if let Some(first) = seen.insert(&item.label, item) {
            let message = format!("{} and {} would both be named `{}`", first.text, item.text, item.label);
            report
                .error(span, "duplicate", message)
                .hint("instances are named after the file without its extension; rename one of the files");
        }
        reserved(report, item);
    }
}

/// Names the items of a list that files are read from as files are named: after their stems.
pub fn stems(report: &mut Diagnostics, axis: &mut Axis) {
    let Along::Items(items) = &mut axis.along else { return };
    if items.iter().any(|item| !item.exact) {
        return;
    }
    for item in &mut *items {
        if let Some(stem) = Path::new(&item.label).file_stem().and_then(|s| s.to_str()) {
            item.label = stem.to_owned();
        }
    }
    name_files(report, axis.span, items);
}
