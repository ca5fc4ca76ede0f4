//! A real browser, driven over its debugging pipe: no driver program and no socket is needed.

use base64::{Engine as _, prelude::BASE64_STANDARD};
use image::RgbImage;
use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::{Value, json};
use std::{
    fs::{File, OpenOptions},
    io::{Read as _, Write as _},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};
use tempfile::TempDir;

/// What makes a page's picture the same on every machine and at every time: one font, of boxes, and no motion, age or adapter.
const STILL: &str = "* { font-family: Boxes !important; animation: none !important; transition: none !important; }
    time { display: inline-block; width: 5em; height: 1em; overflow: hidden; visibility: hidden; }
    .top .adapter { display: none !important; }";

const PATIENCE: Duration = Duration::from_secs(20);

/// Debian's name for the browser, or Ubuntu's.
fn program() -> &'static str {
    let runs = |name: &&&str| Command::new(name).arg("--version").output().is_ok();
    let found = ["chromium", "chromium-browser"].iter().find(runs);
    found.expect("this test needs a browser: install the package `chromium`")
}

/// One page of one browser.
pub struct Page {
    process: Child,
    to: File,
    from: File,
    heard: Vec<u8>,
    last_id: u64,
    session: Option<String>,
    /// What went wrong on the page since it was opened.
    pub errors: Vec<String>,
    _profile: TempDir,
}

impl Page {
    /// 1280 × 900 pixels of a light page.
    pub fn open() -> Self {
        let profile = tempfile::tempdir().unwrap();
        let [to, from] = ["to", "from"].map(|name| profile.path().join(name));
        for pipe in [&to, &from] {
            mknodat(CWD, pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        }
        // The browser reads commands from descriptor 3 and answers on 4.
        let process = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<\"$TO\" 4>\"$FROM\""])
            .arg(program())
            .args([
                "--headless",
                "--no-sandbox",
                "--remote-debugging-pipe",
                "--no-first-run",
            ])
            .args(["--disable-quic", "--disable-sync", "--disable-background-networking"])
            .args(["--disable-component-update", "--enable-unsafe-swiftshader"])
            .arg(format!("--user-data-dir={}", profile.path().join("profile").display()))
            .arg("about:blank")
            .env("TO", &to)
            .env("FROM", &from)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut page = Self {
            process,
            to: OpenOptions::new().write(true).open(&to).unwrap(),
            from: File::open(&from).unwrap(),
            heard: Vec::new(),
            last_id: 0,
            session: None,
            errors: Vec::new(),
            _profile: profile,
        };
        let targets = page.send("Target.getTargets", &json!({}));
        let targets = targets["targetInfos"].as_array().unwrap().clone();
        let target = targets.iter().find(|target| target["type"] == "page").unwrap();
        let attached = page.send(
            "Target.attachToTarget",
            &json!({"targetId": target["targetId"], "flatten": true}),
        );
        page.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log"] {
            page.send(&format!("{domain}.enable"), &json!({}));
        }
        page.resize(1280, 900, false);
        page
    }

    fn hear(&mut self) -> Value {
        loop {
            if let Some(end) = self.heard.iter().position(|byte| *byte == 0) {
                let message: Vec<u8> = self.heard.drain(..=end).collect();
                return serde_json::from_slice(&message[..end]).unwrap();
            }
            let mut chunk = vec![0; 1 << 16];
            let n_read = self.from.read(&mut chunk).unwrap();
            assert!(n_read > 0, "the browser has gone");
            self.heard.extend_from_slice(&chunk[..n_read]);
        }
    }

    /// A command of the DevTools protocol and its result.
    #[track_caller]
    pub fn send(&mut self, method: &str, parameters: &Value) -> Value {
        let answer = self.ask(method, parameters);
        answer.unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    /// The same, or what the browser says in its place.
    fn ask(&mut self, method: &str, parameters: &Value) -> Result<Value, Value> {
        self.last_id += 1;
        let mut message = json!({"id": self.last_id, "method": method, "params": parameters});
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let answer = self.hear();
            if answer["id"] == self.last_id {
                return match &answer["error"] {
                    Value::Null => Ok(answer["result"].clone()),
                    error => Err(error.clone()),
                };
            }
            match answer["method"].as_str() {
                Some("Runtime.exceptionThrown") => {
                    self.errors.push(answer["params"]["exceptionDetails"].to_string());
                }
                Some("Log.entryAdded") if answer["params"]["entry"]["level"] == "error" => {
                    self.errors.push(answer["params"]["entry"].to_string());
                }
                _ => {}
            }
        }
    }

    pub fn resize(&mut self, width: u32, height: u32, dark: bool) {
        let size = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500});
        self.send("Emulation.setDeviceMetricsOverride", &size);
        let scheme = json!({"name": "prefers-color-scheme", "value": if dark { "dark" } else { "light" }});
        self.send("Emulation.setEmulatedMedia", &json!({"features": [scheme]}));
    }

    /// What an expression is on the page, promises waited for.
    #[track_caller]
    pub fn value(&mut self, expression: &str) -> Value {
        let asked = json!({"expression": expression, "returnByValue": true, "awaitPromise": true});
        let answer = self.send("Runtime.evaluate", &asked);
        assert!(
            answer["exceptionDetails"].is_null(),
            "{expression}: {}",
            answer["exceptionDetails"]
        );
        answer["result"]["value"].clone()
    }

    #[track_caller]
    pub fn text(&mut self, expression: &str) -> String {
        let value = self.value(expression);
        value
            .as_str()
            .unwrap_or_else(|| panic!("{expression} is {value}"))
            .to_owned()
    }

    #[track_caller]
    pub fn number(&mut self, expression: &str) -> f64 {
        let value = self.value(expression);
        value.as_f64().unwrap_or_else(|| panic!("{expression} is {value}"))
    }

    /// Waits until an expression holds.
    #[track_caller]
    pub fn until(&mut self, expression: &str) {
        let deadline = Instant::now() + PATIENCE;
        // A page that is being left answers with an error.
        let asked = json!({"expression": format!("!!({expression})"), "returnByValue": true});
        while !self
            .ask("Runtime.evaluate", &asked)
            .is_ok_and(|answer| answer["result"]["value"] == true)
        {
            if Instant::now() > deadline {
                let address = self.text("location.href");
                let body = self.text("document.body.innerText.slice(0, 2000)");
                panic!(
                    "`{expression}` never held at {address}; errors: {:?}\n{body}",
                    self.errors
                );
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Opens an address and waits until all of it is there.
    #[track_caller]
    pub fn go(&mut self, url: &str) {
        self.errors.clear();
        self.send("Page.navigate", &json!({"url": url}));
        self.until("document.readyState === 'complete' && location.href !== 'about:blank'");
    }

    /// Where the middle of an element is, scrolled into view.
    #[track_caller]
    pub fn middle(&mut self, selector: &str) -> [f64; 2] {
        let place = self.value(&format!(
            "(() => {{ const e = document.querySelector({selector:?}); e.scrollIntoView({{block: 'center'}});
               const r = e.getBoundingClientRect(); return [r.left + r.width / 2, r.top + r.height / 2]; }})()"
        ));
        [0, 1].map(|i| place[i].as_f64().unwrap())
    }

    pub fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) {
        let pressed = i32::from(kind != "mouseReleased");
        let event = json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": pressed, "clickCount": 1});
        self.send("Input.dispatchMouseEvent", &event);
    }

    /// Clicks an element as soon as it is there and nothing lies over it.
    #[track_caller]
    pub fn click(&mut self, selector: &str) {
        self.until(&format!(
            "(() => {{ const e = document.querySelector({selector:?}); e.scrollIntoView({{block: 'center'}});
               const r = e.getBoundingClientRect();
               return e.contains(document.elementFromPoint(r.left + r.width / 2, r.top + r.height / 2)); }})()"
        ));
        let place = self.middle(selector);
        self.click_at(place);
    }

    pub fn click_at(&mut self, place: [f64; 2]) {
        let event = json!({"type": "mouseMoved", "x": place[0], "y": place[1]});
        self.send("Input.dispatchMouseEvent", &event);
        self.mouse("mousePressed", place);
        self.mouse("mouseReleased", place);
    }

    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        let moved = json!({"type": "mouseMoved", "x": from[0], "y": from[1]});
        self.send("Input.dispatchMouseEvent", &moved);
        self.mouse("mousePressed", from);
        for share in [0.3, 0.7, 1.0] {
            self.mouse("mouseMoved", [0, 1].map(|i| from[i] + share * (to[i] - from[i])));
        }
        self.mouse("mouseReleased", to);
    }

    pub fn key(&mut self, key: &str) {
        let text = if key.chars().count() == 1 { key } else { "" };
        let text = if key == "Enter" { "\r" } else { text };
        for kind in ["keyDown", "keyUp"] {
            let event = json!({"type": kind, "key": key, "text": if kind == "keyDown" { text } else { "" }});
            self.send("Input.dispatchKeyEvent", &event);
        }
    }

    /// From the next address on, pages can be [pictured](Self::picture) alike anywhere.
    pub fn stand_still(&mut self) {
        let font = BASE64_STANDARD.encode(include_bytes!("../../../fixtures/pages/boxes.ttf"));
        let source = format!(
            "document.fonts.add(new FontFace('Boxes', Uint8Array.from(atob('{font}'), (c) => c.charCodeAt(0))));
             const still = new CSSStyleSheet();
             still.replaceSync(`{STILL}`);
             document.adoptedStyleSheets.push(still);"
        );
        self.send("Page.addScriptToEvaluateOnNewDocument", &json!({"source": source}));
        self.send("Emulation.setScrollbarsHidden", &json!({"hidden": true}));
    }

    /// What is seen of the page.
    pub fn picture(&mut self) -> RgbImage {
        let drawn = "document.fonts.ready.then(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1)))))";
        self.value(drawn);
        let answer = self.send("Page.captureScreenshot", &json!({"format": "png"}));
        let png = BASE64_STANDARD.decode(answer["data"].as_str().unwrap()).unwrap();
        image::load_from_memory(&png).unwrap().to_rgb8()
    }

    /// That nothing went wrong since the page was opened.
    #[track_caller]
    pub fn is_well(&mut self) {
        self.value("1");
        assert_eq!(self.errors, Vec::<String>::new());
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
