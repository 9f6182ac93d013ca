//! A browser window: starts the driver and the browser, and ends both.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use fantoccini::actions::{InputSource, MouseActions, PointerAction};
use fantoccini::{Client, ClientBuilder};
use serde_json::{Value, json};

/// A window with a page.
pub struct Window {
    driver: Child,
    port: u16,
    session: String,
    client: Client,
    runtime: tokio::runtime::Runtime,
}

/// Where the driver is that `tests/run` installs, or why tests are skipped.
fn driver() -> Option<Child> {
    let started = Command::new("chromedriver").args(["--port=0"]).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    match started {
        Ok(child) => Some(child),
        Err(e) if std::env::var_os("SALIENT_BROWSER").is_some() => panic!("chromedriver does not start: {e}"),
        Err(_) => {
            eprintln!("skipped: chromedriver is not installed (tests/run installs it)");
            None
        }
    }
}

impl Window {
    /// Opens a page, wide enough for everything; `None` where there is no browser.
    pub fn open(url: &str) -> Option<Self> {
        let mut driver = driver()?;
        let lines = BufReader::new(driver.stdout.take().unwrap()).lines();
        let started = lines.map_while(Result::ok).find(|line| line.contains("started successfully on port"));
        let port = started.and_then(|line| line.trim_end_matches('.').rsplit(' ').next()?.parse().ok()).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        // Without a graphics card; containers have no namespaces for the sandbox and little shared memory.
        let arguments = [
            "--headless=new",
            "--no-sandbox",
            "--disable-dev-shm-usage",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--window-size=1300,900",
        ];
        let capabilities = json!({
            "goog:chromeOptions": { "args": arguments },
            "goog:loggingPrefs": { "browser": "ALL" },
        });
        let Value::Object(capabilities) = capabilities else { unreachable!() };
        let connector = hyper_util::client::legacy::connect::HttpConnector::new();
        let client = runtime.block_on(async {
            let mut builder = ClientBuilder::new(connector);
            builder.capabilities(capabilities);
            builder.connect(&format!("http://127.0.0.1:{port}")).await.unwrap()
        });
        let session = runtime.block_on(client.session_id()).unwrap().unwrap();
        let window = Self { driver, port, session, client, runtime };
        window.runtime.block_on(window.client.goto(url)).unwrap();
        window.wait("return Boolean(window.salient && salient.scene())");
        Some(window)
    }

    /// Runs a script in the page; `args` are its `arguments`.
    pub fn js(&self, script: &str, args: &[Value]) -> Value {
        self.runtime.block_on(self.client.execute(script, args.to_vec())).unwrap_or_else(|e| panic!("{script}: {e}"))
    }

    /// A number that a script returns.
    pub fn number(&self, script: &str) -> f64 {
        self.js(script, &[]).as_f64().unwrap_or_else(|| panic!("not a number: {script}"))
    }

    /// The text of an element.
    pub fn text(&self, id: &str) -> String {
        self.js("return document.getElementById(arguments[0]).innerText", &[id.into()]).as_str().unwrap().to_owned()
    }

    /// Waits until a script returns true.
    pub fn wait(&self, script: &str) {
        let start = Instant::now();
        while self.js(script, &[]) != json!(true) {
            assert!(start.elapsed() < Duration::from_secs(30), "still not: {script}\n{:?}", self.complaints());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Presses a key.
    pub fn key(&self, selector: &str, key: &str) {
        let press = async {
            let element = self.client.find(fantoccini::Locator::Css(selector)).await?;
            element.send_keys(key).await
        };
        self.runtime.block_on(press).unwrap();
    }

    /// Presses the mouse at a place of the stage, moves it through the others and lets go.
    pub fn drag(&self, places: &[[f64; 2]]) {
        let corner =
            self.js("const b = document.getElementById('stage').getBoundingClientRect(); return [b.x, b.y]", &[]);
        let [x, y] = [0, 1].map(|i| corner[i].as_f64().unwrap());
        let to = |[dx, dy]: [f64; 2]| PointerAction::MoveTo { duration: None, x: x + dx, y: y + dy };
        let mut mouse = MouseActions::new("mouse".into()).then(to(places[0])).then(PointerAction::Down { button: 0 });
        for place in &places[1..] {
            mouse = mouse.then(to(*place));
        }
        let mouse = mouse.then(PointerAction::Up { button: 0 });
        self.runtime.block_on(self.client.perform_actions(mouse)).unwrap();
    }

    /// Warnings and errors of the console since the last time.
    pub fn complaints(&self) -> Vec<String> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let (body, session) = (r#"{"type":"browser"}"#, &self.session);
        let head = format!(
            "POST /session/{session}/se/log HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: {}",
            body.len()
        );
        write!(stream, "{head}\r\n\r\n{body}").unwrap();
        // The driver keeps the connection open, so the length counts.
        let (mut reader, mut length) = (BufReader::new(stream), 0);
        loop {
            let mut line = String::new();
            reader.read_line(&mut line).unwrap();
            if let Some(value) = line.to_lowercase().strip_prefix("content-length:") {
                length = value.trim().parse().unwrap();
            }
            if line.trim().is_empty() {
                break;
            }
        }
        let mut answer = vec![0; length];
        reader.read_exact(&mut answer).unwrap();
        let entries: Value = serde_json::from_slice(&answer).unwrap();
        let entries = entries["value"].as_array().unwrap().iter();
        entries
            .filter(|entry| entry["level"] != "INFO" && entry["level"] != "DEBUG")
            .map(|entry| entry["message"].to_string())
            .collect()
    }

    /// What is drawn on the stage, as the smallest box that holds it, and how many pixels that is, for each panel.
    pub fn drawn(&self) -> Vec<Drawn> {
        let all = self.js(
            "salient.draw();
             const canvas = document.getElementById('canvas'), copy = document.createElement('canvas');
             [copy.width, copy.height] = [canvas.width, canvas.height];
             const context = copy.getContext('2d', { willReadFrequently: true });
             context.drawImage(canvas, 0, 0);
             const scale = canvas.width / canvas.clientWidth;
             return salient.panels().map((panel) => {
               const { x, y, w, h } = panel.rect, [left, top, width, height] = [x, y, w, h].map((v) => Math.round(v * scale));
               const data = context.getImageData(left, top, width, height).data;
               let pixels = 0, box = [Infinity, Infinity, -Infinity, -Infinity], sum = 0;
               for (let i = 0; i < width * height; i++) {
                 if (data[4 * i + 3] < 128) continue;
                 pixels++;
                 const px = i % width / scale, py = Math.floor(i / width) / scale;
                 box = [Math.min(box[0], px), Math.min(box[1], py), Math.max(box[2], px), Math.max(box[3], py)];
                 sum = (sum * 31 + data[4 * i] * 65536 + data[4 * i + 1] * 256 + data[4 * i + 2] + i) % 2147483647;
               }
               return { pixels, box, sum };
             });",
            &[],
        );
        let number = |value: &Value| value.as_f64().unwrap();
        let one = |it: &Value| Drawn {
            pixels: number(&it["pixels"]),
            bounds: std::array::from_fn(|i| it["box"][i].as_f64().unwrap_or(f64::NAN)),
            sum: number(&it["sum"]) as u64,
        };
        all.as_array().unwrap().iter().map(one).collect()
    }

    /// The colour, red, green and blue, at a place of the stage.
    pub fn colour(&self, place: [f64; 2]) -> [f64; 3] {
        let found = self.js(
            "salient.draw();
             const canvas = document.getElementById('canvas'), copy = document.createElement('canvas');
             [copy.width, copy.height] = [canvas.width, canvas.height];
             const context = copy.getContext('2d'), scale = canvas.width / canvas.clientWidth;
             context.drawImage(canvas, 0, 0);
             return [...context.getImageData(arguments[0] * scale, arguments[1] * scale, 1, 1).data];",
            &place.map(Value::from),
        );
        std::array::from_fn(|i| found[i].as_f64().unwrap())
    }
}

/// What is drawn in a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    /// How many pixels are not background.
    pub pixels: f64,
    /// Left, top, right, bottom, from the panel's corner.
    pub bounds: [f64; 4],
    /// A checksum of colours and places.
    pub sum: u64,
}

impl Drop for Window {
    fn drop(&mut self) {
        // The browser ends with its session; the driver does not end by itself.
        let _ = self.runtime.block_on(self.client.clone().close());
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}
