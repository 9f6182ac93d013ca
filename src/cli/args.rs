//! The arguments of every command.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::export::{ColourMap, Format};

/// Declarative graphs for spectral shape analysis, recomputing only what an edit touches.
#[derive(Parser)]
#[command(name = "salient", version, max_term_width = 100)]
#[command(after_help = "Exit codes: 0 done; 1 a node failed or the cache cannot be used; 2 the call \
    or the graph is wrong; 130 interrupted.\nResults go to standard output, all else to standard error.")]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Subcommand)]
pub enum Command {
    /// Compute what a graph shows, and print a table of results
    Run(RunArgs),
    /// Compute what a graph shows, and again whenever a file of it changes, until Ctrl-C
    Watch(WatchArgs),
    /// Write one node's output in a format of other tools
    Get(GetArgs),
    /// Report all that is wrong with graph files
    Check(CheckArgs),
    /// List what a run would find in the cache and what it would compute, and why
    Plan(PlanArgs),
    /// Compute variants, graphs or a graph and its last run, and show where they part and what follows
    Compare(CompareArgs),
    /// List the runs that the cache remembers, or one of them: what it computed, and why
    Runs(RunsArgs),
    /// Print the plan as a picture
    Graph(GraphArgs),
    /// Document the kinds of node
    Nodes(NodesArgs),
    /// Look after the cache
    Cache(CacheArgs),
    /// Print a completion script
    Completions {
        /// For which shell
        shell: clap_complete::Shell,
    },
}

/// Which graph, and how it is changed.
#[derive(Args)]
pub struct GraphChoice {
    /// The graph file; paths in it are relative to it
    pub graph: PathBuf,
    /// Replace a param of the graph (`shapes=files("DIR/*.off")`) or of a node (`fa/patches.radius=2.0`)
    #[arg(long = "set", value_name = "NAME=RON")]
    pub sets: Vec<String>,
    /// Only these variants; repeat it, or separate names by commas
    #[arg(long = "variant", value_name = "NAME")]
    pub variants: Vec<String>,
}

/// Where the cache is.
#[derive(Args)]
pub struct CacheChoice {
    /// The cache directory, which any number of processes and hosts may share [default: `SALIENT_CACHE`, else
    /// `XDG_CACHE_HOME/salient`, else `~/.cache/salient`]
    #[arg(long = "cache", value_name = "DIR", global = true)]
    pub dir: Option<PathBuf>,
}

/// How to compute; never changes a result.
#[derive(Args)]
pub struct Effort {
    /// How many threads compute [default: one per processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub jobs: Option<u16>,
    /// How many gigabytes of outputs are held in memory between nodes; what does not fit is read from the cache again
    #[arg(long, value_name = "GB", default_value = "4", value_parser = gigabytes)]
    pub memory: u64,
    /// Stop at the first node that fails; what is finished is kept
    #[arg(long, overrides_with = "keep_going")]
    pub fail_fast: bool,
    /// Complete all that does not rest on a failed node [default]
    #[arg(long, overrides_with = "fail_fast")]
    pub keep_going: bool,
}

/// A page with the results on the shapes themselves.
#[derive(Args)]
pub struct ReportChoice {
    /// Write a page that shows the results on the shapes: one file, opened from disk in any browser
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Whether the page holds the drawing library (0.5 MB), or many pages share one beside them
    #[arg(long, value_enum, value_name = "WHERE", default_value = "inline", requires = "report")]
    pub report_assets: AssetsChoice,
    /// Surfaces with more vertices than this are shown simplified
    #[arg(long, value_name = "VERTICES", default_value_t = crate::report::DETAIL as u32, requires = "report",
        value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    pub report_detail: u32,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AssetsChoice {
    /// In the page
    Inline,
    /// In a file beside the page
    Shared,
}

impl From<AssetsChoice> for crate::report::Assets {
    fn from(choice: AssetsChoice) -> Self {
        match choice {
            AssetsChoice::Inline => Self::Inline,
            AssetsChoice::Shared => Self::Shared,
        }
    }
}

#[derive(Args)]
pub struct RunArgs {
    #[command(flatten)]
    pub graph: GraphChoice,
    #[command(flatten)]
    pub cache: CacheChoice,
    #[command(flatten)]
    pub effort: Effort,
    /// Write each result to this folder, as JSON and as safetensors
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub report: ReportChoice,
    /// Print events as lines of JSON on standard output; the last has `"event": "results"`, with the digest, summary
    /// and defects of each result
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct WatchArgs {
    #[command(flatten)]
    pub graph: GraphChoice,
    #[command(flatten)]
    pub cache: CacheChoice,
    #[command(flatten)]
    pub effort: Effort,
    /// Write each result to this folder whenever it has changed, as JSON and as safetensors
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print events as lines of JSON on standard output: those of `run --json`, and `changed`, `broken` and `watching`
    #[arg(long)]
    pub json: bool,
    /// Look at all files every so many seconds, and do not rely on notices of the system, which miss what other
    /// hosts write to a network file system [default: notices, and a look every 2 seconds]
    #[arg(long, value_name = "SECONDS", value_parser = period)]
    pub poll: Option<Duration>,
    /// Keep a page current that shows the results on the shapes. Without an address it is at 127.0.0.1:7700 (or, if that
    /// is taken, at another port), where only this host reaches it
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = "", value_parser = serve_address)]
    pub serve: Option<String>,
    /// Surfaces with more vertices than this are shown simplified
    #[arg(long, value_name = "VERTICES", default_value_t = crate::report::DETAIL as u32, requires = "serve",
        value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    pub report_detail: u32,
}

#[derive(Args)]
pub struct GetArgs {
    #[command(flatten)]
    pub graph: GraphChoice,
    /// The node's address: `basis`, `fa/basis` in a subgraph call, `mesh[cat]` on an axis, `paper:match` in a variant
    pub node: String,
    /// The file to write; `-` or nothing is standard output
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// The format [default: by the extension of FILE, else json]
    #[arg(long, value_enum)]
    pub format: Option<Format>,
    /// In a drawing, which of several: eigenfunction or energy k, the patch of a feature, or a correspondence (0 the match,
    /// 1 its mirror twin) [default: the first that is not constant; all features; the match]
    #[arg(long, value_name = "N")]
    pub index: Option<usize>,
    /// In a drawing, how values become vertex colours [default: auto]
    #[arg(long, value_enum, value_name = "MAP")]
    pub colours: Option<ColourMap>,
    /// Draw features and matches as points and lines alone, without the surfaces that they lie on
    #[arg(long)]
    pub bare: bool,
    #[command(flatten)]
    pub cache: CacheChoice,
    #[command(flatten)]
    pub effort: Effort,
}

#[derive(Args)]
pub struct CheckArgs {
    /// Graph files
    #[arg(required = true)]
    pub graphs: Vec<PathBuf>,
    /// Replace a param first, as `run` does
    #[arg(long = "set", value_name = "NAME=RON")]
    pub sets: Vec<String>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct PlanArgs {
    #[command(flatten)]
    pub graph: GraphChoice,
    #[command(flatten)]
    pub cache: CacheChoice,
    /// Explain why this node would execute: which param, file, input or version changed, and since when
    #[arg(long, value_name = "NODE")]
    pub why: Option<String>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct CompareArgs {
    /// One graph, whose variants are compared, or else it and its last run; or several graphs
    #[arg(required_unless_present = "runs")]
    pub graphs: Vec<PathBuf>,
    /// Replace a param first, as `run` does; in every graph
    #[arg(long = "set", value_name = "NAME=RON")]
    pub sets: Vec<String>,
    /// Only these variants; repeat it, or separate names by commas
    #[arg(long = "variant", alias = "variants", value_name = "NAME")]
    pub variants: Vec<String>,
    /// A recorded run, as `salient runs` names it; repeat it to compare runs, or give a graph to compare with
    #[arg(long = "run", value_name = "RUN")]
    pub runs: Vec<String>,
    /// Compare with the graph's last run, even if it has variants
    #[arg(long, conflicts_with = "runs")]
    pub last: bool,
    /// Only pairs with this one
    #[arg(long, value_name = "NAME")]
    pub against: Option<String>,
    #[command(flatten)]
    pub cache: CacheChoice,
    #[command(flatten)]
    pub effort: Effort,
    #[command(flatten)]
    pub report: ReportChoice,
    /// Print one JSON document, with every differing node
    #[arg(long, conflicts_with = "csv")]
    pub json: bool,
    /// Print the table (one line for each figure and column) or the differences as CSV
    #[arg(long, value_enum, value_name = "WHAT", num_args = 0..=1, default_missing_value = "table", require_equals = true)]
    pub csv: Option<CsvOf>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CsvOf {
    /// Figures of results and costs of stages
    Table,
    /// Differences of pairs
    Differences,
}

#[derive(Args)]
pub struct RunsArgs {
    /// Only runs of this graph file
    pub graph: Option<PathBuf>,
    /// One run: the first digits of its name, `last`, or `last~1` for the one before
    #[arg(long, value_name = "RUN")]
    pub run: Option<String>,
    /// Explain why that run, or the last, executed this node
    #[arg(long, value_name = "NODE")]
    pub why: Option<String>,
    #[command(flatten)]
    pub cache: CacheChoice,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct GraphArgs {
    #[command(flatten)]
    pub graph: GraphChoice,
    /// The language of the picture
    #[arg(long, value_enum, default_value = "dot")]
    pub format: Picture,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Picture {
    /// Graphviz
    Dot,
    /// Mermaid, as Markdown pages show it
    Mermaid,
}

#[derive(Args)]
pub struct NodesArgs {
    /// One kind, in full
    pub kind: Option<String>,
    /// Print the JSON schema of its params
    #[arg(long, requires = "kind")]
    pub schema: bool,
}

#[derive(Args)]
pub struct CacheArgs {
    #[command(flatten)]
    pub cache: CacheChoice,
    /// Print one JSON document
    #[arg(long, global = true)]
    pub json: bool,
    #[command(subcommand)]
    pub command: CacheCommand,
}

#[derive(Subcommand)]
pub enum CacheCommand {
    /// Count what is there
    Stat,
    /// Read and check everything; damaged files are removed
    Verify,
    /// Remove what is too old or too much. What was used within the last hour, or since an hour before the oldest
    /// living run on any host began, is never removed
    Gc {
        /// Remove outputs, longest unused first, until at most this much is left (`10GB`, `500MB`)
        #[arg(long, value_name = "SIZE", value_parser = size)]
        max_size: Option<u64>,
        /// Remove what was not used for so long (`30d`, `12h`)
        #[arg(long, value_name = "AGE", value_parser = age)]
        max_age: Option<Duration>,
    },
    /// Remove everything; refused while runs use the cache
    Clear,
}

fn split(text: &str) -> (&str, String) {
    let end = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    (&text[..end], text[end..].trim().to_lowercase())
}

fn scaled(number: &str, unit: Option<f64>) -> Option<f64> {
    number.parse::<f64>().ok().zip(unit).map(|(number, unit)| number * unit)
}

fn size(text: &str) -> Result<u64, String> {
    let (number, unit) = split(text.trim());
    let unit = match unit.as_str() {
        "" | "b" => Some(1.0),
        "kb" | "k" => Some(1e3),
        "mb" | "m" => Some(1e6),
        "gb" | "g" => Some(1e9),
        "tb" | "t" => Some(1e12),
        "kib" => Some(1024.0),
        "mib" => Some(1024.0 * 1024.0),
        "gib" => Some(1024.0 * 1024.0 * 1024.0),
        _ => None,
    };
    scaled(number, unit).map(|bytes| bytes as u64).ok_or_else(|| "a size like 10GB or 500MB".into())
}

fn age(text: &str) -> Result<Duration, String> {
    let (number, unit) = split(text.trim());
    let unit = match unit.as_str() {
        "s" => Some(1.0),
        "m" | "min" => Some(60.0),
        "h" => Some(3600.0),
        "d" => Some(24.0 * 3600.0),
        "w" => Some(7.0 * 24.0 * 3600.0),
        _ => None,
    };
    let wrong = || "an age like 30d or 12h".to_owned();
    let seconds = scaled(number, unit).ok_or_else(wrong)?;
    Duration::try_from_secs_f64(seconds).map_err(|_| wrong())
}

fn period(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().ok().filter(|x| (0.05..=3600.0).contains(x));
    seconds.map(Duration::from_secs_f64).ok_or_else(|| "a number of seconds from 0.05 to 3600".into())
}

fn serve_address(text: &str) -> Result<String, String> {
    let port = text.rsplit_once(':').filter(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
    if text.is_empty() || port.is_some() {
        return Ok(text.to_owned());
    }
    Err("an address is HOST:PORT, as 127.0.0.1:7700 or 0.0.0.0:0; for the usual one write --serve last, after the graph".into())
}

fn gigabytes(text: &str) -> Result<u64, String> {
    let number = text.parse::<f64>().ok().filter(|x| x.is_finite() && *x >= 0.0);
    number.map(|x| (x * 1e9) as u64).ok_or_else(|| "a number of gigabytes, 0 or more".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn sizes_and_ages() {
        assert_eq!(size("10GB"), Ok(10_000_000_000));
        assert_eq!(size("1.5 MiB"), Ok(1_572_864));
        assert_eq!(size("7"), Ok(7));
        assert!(size("GB").is_err() && size("3 apples").is_err() && size("-1GB").is_err());
        assert_eq!(age("30d"), Ok(Duration::from_secs(30 * 86400)));
        assert_eq!(age("1.5h"), Ok(Duration::from_secs(5400)));
        assert!(age("30").is_err() && age("d").is_err());
        assert_eq!(gigabytes("0"), Ok(0));
        assert!(gigabytes("inf").is_err());
        assert_eq!(period("0.5"), Ok(Duration::from_millis(500)));
        assert!(period("0").is_err() && period("NaN").is_err() && period("2s").is_err());
    }
}
