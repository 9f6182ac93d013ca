//! The live page: a small server for what a watch shows, on loopback unless somebody says otherwise.
//!
//! | path | gives |
//! |---|---|
//! | `/` | the page |
//! | `/events` | server-sent events: what is going on, and the number of the newest scene |
//! | `/scene.json` | the newest scene |
//! | `/blob/NAME` | one of its arrays; a page asks only for those that it does not have |
//!
//! Nothing is read from disk for a request: there are these paths, and what is in memory. A request must name this host by
//! an address, by `localhost` or by the name given to `--serve`, so that no other site can reach it by a name of its own that
//! it turns to this address (DNS rebinding).

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener, ToSocketAddrs};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::sse::{Event as Sent, KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;
use futures_util::stream::{Stream, unfold};
use serde::Serialize;
use tokio::sync::watch;

use super::blobs::Blobs;
use super::page;
use super::scene::Scene;
use crate::engine::Event;

/// Where the page is if nothing is said.
const USUAL: &str = "127.0.0.1:7700";
/// Between two news to one page: what happens meanwhile is told together.
const PACE: Duration = Duration::from_millis(60);

/// A running server.
pub struct Server {
    /// Where it is.
    pub address: SocketAddr,
    shared: Arc<Shared>,
}

struct Shared {
    page: String,
    /// The host of `--serve`.
    host: String,
    now: Mutex<Now>,
    /// Counts changes of `now`.
    changes: watch::Sender<u64>,
}

/// What pages are told.
#[derive(Default)]
struct Now {
    news: News,
    scene: String,
    blobs: Blobs,
    /// Arrays of the scene before: a page may still be fetching them.
    former: Blobs,
}

#[derive(Clone, Default, Serialize)]
struct News {
    /// Number of the newest scene; 0 before the first.
    revision: u64,
    phase: Phase,
    done: usize,
    calls: usize,
    /// Addresses of the nodes that are computed.
    running: BTreeSet<String>,
    /// What is wrong, as on the terminal.
    trouble: Option<String>,
}

#[derive(Clone, Copy, Default, Serialize)]
#[serde(rename_all = "snake_case")]
enum Phase {
    #[default]
    Running,
    Watching,
    Broken,
}

impl Server {
    /// Serves at an address (`HOST:PORT`), or at the usual place if it is empty. The title is that of the page before
    /// its first scene.
    pub fn start(address: &str, title: &str) -> io::Result<Self> {
        let listener = if address.is_empty() { bind(USUAL).or_else(|_| bind("127.0.0.1:0")) } else { bind(address) }?;
        listener.set_nonblocking(true)?;
        let host = address.rsplit_once(':').map_or("", |(host, _)| host).to_lowercase();
        let shared =
            Arc::new(Shared { page: page::live(title), host, now: Mutex::default(), changes: watch::Sender::new(0) });
        let address = listener.local_addr()?;
        let router = router(shared.clone());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        // It lives as long as the process.
        std::thread::Builder::new().name("page".into()).spawn(move || {
            runtime.block_on(async move {
                if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
                    // It ends with the process; an error of one connection does not end it.
                    let _ = axum::serve(listener, router).await;
                }
            });
        })?;
        Ok(Self { address, shared })
    }

    /// Shows another scene.
    pub fn scene(&self, scene: &Scene, blobs: Blobs) {
        let text = page::json(scene);
        self.change(|now| {
            now.former = std::mem::replace(&mut now.blobs, blobs);
            now.scene = text;
            now.news.revision += 1;
        });
    }

    /// Says what is wrong, in the words of the terminal; nothing if nothing is.
    pub fn trouble(&self, text: Option<String>) {
        self.change(|now| now.news.trouble = text);
    }

    /// Tells of an event of the watch.
    pub fn event(&self, event: &Event) {
        match event {
            Event::RunStarted { calls, .. } => self.change(|now| {
                let News { revision, .. } = now.news;
                now.news = News { revision, calls: *calls, ..News::default() };
            }),
            Event::Tally { done, calls, .. } => self.change(|now| (now.news.done, now.news.calls) = (*done, *calls)),
            Event::Started { node, .. } => self.change(|now| {
                now.news.running.insert(node.clone());
            }),
            Event::Hit { .. } => self.change(|now| now.news.done += 1),
            Event::Finished { node, .. } | Event::Failed { node, .. } => self.change(|now| {
                now.news.running.remove(node);
                now.news.done += 1;
            }),
            Event::Broken { text, .. } => self.change(|now| {
                (now.news.phase, now.news.trouble) = (Phase::Broken, Some(text.clone()));
            }),
            Event::Watching { .. } => self.change(|now| {
                if !matches!(now.news.phase, Phase::Broken) {
                    now.news.phase = Phase::Watching;
                }
                now.news.running.clear();
            }),
            _ => {}
        }
    }

    fn change(&self, how: impl FnOnce(&mut Now)) {
        how(&mut self.shared.now());
        self.shared.changes.send_modify(|count| *count += 1);
    }
}

fn bind(address: &str) -> io::Result<TcpListener> {
    TcpListener::bind(&*address.to_socket_addrs()?.collect::<Vec<_>>())
}

impl Shared {
    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a request means this host: see the module.
    fn is_meant(&self, host: &str) -> bool {
        let name = match host.strip_prefix('[') {
            Some(rest) => rest.split_once(']').map_or(rest, |(name, _)| name),
            None => host.rsplit_once(':').map_or(host, |(name, _)| name),
        };
        let name = name.to_lowercase();
        name.parse::<IpAddr>().is_ok() || name == "localhost" || (!name.is_empty() && name == self.host)
    }
}

fn router(shared: Arc<Shared>) -> Router {
    Router::new()
        .route("/", get(async |State(it): State<Arc<Shared>>| Html(it.page.clone())))
        .route(
            "/events",
            get(async |State(it): State<Arc<Shared>>| Sse::new(news(it)).keep_alive(KeepAlive::default())),
        )
        .route("/scene.json", get(scene))
        .route("/blob/{name}", get(blob))
        .layer(from_fn_with_state(shared.clone(), guard))
        .with_state(shared)
}

async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    if !shared.is_meant(host) {
        return (StatusCode::FORBIDDEN, "this page is reached by an address or by the name given to --serve\n")
            .into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::X_FRAME_OPTIONS, HeaderValue::from_static("DENY"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    response
}

async fn scene(State(shared): State<Arc<Shared>>) -> Response {
    let (text, revision) = {
        let now = shared.now();
        (now.scene.clone(), now.news.revision)
    };
    if revision == 0 {
        return StatusCode::NOT_FOUND.into_response();
    }
    let head = [
        (header::CONTENT_TYPE, "application/json".to_owned()),
        (header::CACHE_CONTROL, "no-store".to_owned()),
        (header::HeaderName::from_static("x-revision"), revision.to_string()),
    ];
    (head, text).into_response()
}

async fn blob(State(shared): State<Arc<Shared>>, Path(name): Path<String>) -> Response {
    let found = {
        let now = shared.now();
        now.blobs.get(&name).or_else(|| now.former.get(&name)).cloned()
    };
    let Some(bytes) = found else { return StatusCode::NOT_FOUND.into_response() };
    // A name stands for one content forever.
    let head =
        [(header::CONTENT_TYPE, "application/octet-stream"), (header::CACHE_CONTROL, "max-age=31536000, immutable")];
    (head, Body::from(bytes.to_vec())).into_response()
}

/// The news now, and again whenever they change.
fn news(shared: Arc<Shared>) -> impl Stream<Item = Result<Sent, Infallible>> {
    let changes = shared.changes.subscribe();
    unfold((shared, changes, true), |(shared, mut changes, first)| async move {
        if !first {
            changes.changed().await.ok()?;
            tokio::time::sleep(PACE).await;
        }
        changes.borrow_and_update();
        let news = shared.now().news.clone();
        Some((Ok(Sent::default().data(page::json(&news))), (shared, changes, false)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpStream;

    fn ask(server: &Server, path: &str, host: &str) -> String {
        let mut stream = TcpStream::connect(server.address).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8_lossy(&answer).into_owned()
    }

    fn status(answer: &str) -> &str {
        answer.split(' ').nth(1).unwrap()
    }

    #[test]
    fn only_its_own_names_and_paths_are_answered() {
        let server = Server::start("127.0.0.1:0", "t").unwrap();
        assert!(server.address.ip().is_loopback());
        for host in ["127.0.0.1:7700", "localhost", "LOCALHOST:80", "[::1]:9", "192.168.1.7:7700"] {
            assert_eq!(status(&ask(&server, "/", host)), "200", "{host}");
        }
        // A site that turns its own name to this address has its name in the request.
        for host in ["evil.example", "evil.example:7700", "localhost.evil.example", "", "127.0.0.1.evil.example:7700"] {
            assert_eq!(status(&ask(&server, "/", host)), "403", "{host}");
        }
        for path in ["/etc/passwd", "/../Cargo.toml", "/blob/..%2fCargo.toml", "/blob/x", "/scene.json", "/page/app.js"]
        {
            assert_eq!(status(&ask(&server, path, "localhost")), "404", "{path}");
        }
    }

    #[test]
    fn a_name_given_to_serve_is_answered() {
        let shared = Shared {
            page: String::new(),
            host: "box.lan".into(),
            now: Mutex::default(),
            changes: watch::Sender::new(0),
        };
        assert!(shared.is_meant("box.lan:7700") && shared.is_meant("Box.LAN"));
        assert!(!shared.is_meant("other.lan:7700"));
    }

    #[test]
    fn arrays_of_the_scene_before_are_still_there() {
        let server = Server::start("127.0.0.1:0", "t").unwrap();
        let mut names = Vec::new();
        for content in [b"one", b"two", b"six"] {
            let mut blobs = Blobs::default();
            names.push(blobs.add(content.to_vec()));
            server.change(|now| {
                now.former = std::mem::replace(&mut now.blobs, blobs);
                now.news.revision += 1;
            });
        }
        let found: Vec<String> =
            names.iter().map(|name| status(&ask(&server, &format!("/blob/{name}"), "localhost")).to_owned()).collect();
        assert_eq!(found, ["404", "200", "200"]);
        assert!(ask(&server, &format!("/blob/{}", names[2]), "localhost").ends_with("six"));
    }
}
