//! The server as programs and other pages see it: what it refuses, and what it keeps.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use retina_view::{View, ViewError, ViewOptions};
use serde_json::{Value, json};

/// A server in this process, for as long as the tests run.
struct Server {
    host: String,
    token: String,
    session: Option<String>,
}

struct Answer {
    status: u16,
    head: String,
    body: String,
}

impl Answer {
    fn json(&self) -> Value {
        assert_eq!(self.status, 200, "{}", self.body);
        serde_json::from_str(&self.body).unwrap()
    }
}

impl Server {
    fn started(paths: &[PathBuf], state: &Path) -> Self {
        let options = ViewOptions { paths: paths.to_vec(), port: 0, state_folder: state.to_path_buf() };
        let view = View::bind(&options).unwrap();
        let address = view.address();
        let (host, token) = address.strip_prefix("http://").unwrap().split_once("/?token=").unwrap();
        let server = Self {
            host: host.to_owned(),
            token: token.to_owned(),
            session: view.session().map(str::to_owned),
        };
        std::thread::spawn(|| view.serve());
        server
    }

    /// A request with these lines of the head.
    fn sent(&self, method: &str, path: &str, head: &[(&str, &str)], body: &str) -> Answer {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut text = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n");
        for (name, value) in head {
            text += &format!("{name}: {value}\r\n");
        }
        text += &format!("Content-Length: {}\r\n\r\n{body}", body.len());
        stream.write_all(text.as_bytes()).unwrap();
        let mut out = Vec::new();
        // A refusal may come before the whole body was taken.
        let _ = stream.read_to_end(&mut out);
        let out = String::from_utf8_lossy(&out);
        let (head, body) = out.split_once("\r\n\r\n").unwrap();
        Answer {
            status: head.split(' ').nth(1).unwrap().parse().unwrap(),
            head: head.to_owned(),
            body: body.to_owned(),
        }
    }

    fn get(&self, path: &str) -> Answer {
        let bearer = format!("Bearer {}", self.token);
        self.sent("GET", path, &[("Host", &self.host), ("Authorization", &bearer)], "")
    }

    fn post(&self, path: &str, body: &Value) -> Answer {
        let bearer = format!("Bearer {}", self.token);
        let head =
            [("Host", self.host.as_str()), ("Authorization", &bearer), ("Content-Type", "application/json")];
        self.sent("POST", path, &head, &body.to_string())
    }

    /// The session when it has read its tables and no job runs.
    fn settled(&self, id: &str) -> Value {
        let start = Instant::now();
        loop {
            let news = self.get(&format!("/api/sessions/{id}")).json();
            if news["phase"] != "loading" && news["job"].is_null() {
                return news;
            }
            assert!(start.elapsed() < Duration::from_secs(120), "{news}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

/// A setup, and a phase curve of thirty nights with a slope that the law has not.
fn measured(folder: &Path) -> [PathBuf; 2] {
    let mut text = String::from("phase_deg,magnitude,night,airmass\n");
    for night in 0..30 {
        for k in 0..4 {
            let phase = f64::from(night) * 3.5 + f64::from(k) * 0.3 + 2.0;
            let noise = 0.01 * (f64::from((night * 7 + k * 3) % 11) - 5.0) / 5.0;
            let alpha = phase.to_radians();
            let pi = std::f64::consts::PI;
            let lambert = -2.5 * ((alpha.sin() + (pi - alpha) * alpha.cos()) / pi).log10();
            text += &format!(
                "{phase},{},n{night:02},{}\n",
                -12.7 + lambert + 0.3 * alpha + noise,
                1.0 + 0.1 * f64::from(k)
            );
        }
    }
    let [setup, table] = [folder.join("setup.toml"), folder.join("phase.csv")];
    std::fs::write(&setup, retina_assets::WIDE_FOV_SETUP).unwrap();
    std::fs::write(&table, text).unwrap();
    [setup, table]
}

#[test]
fn only_who_knows_the_token_by_a_name_of_this_machine_is_answered() {
    let dir = tempfile::tempdir().unwrap();
    let server = Server::started(&[], dir.path());
    let own = server.host.clone();
    let bearer = format!("Bearer {}", server.token);
    let wrong = format!("Bearer {}", "0".repeat(48));
    for (head, status) in [
        (vec![("Host", own.as_str())], 403),
        (vec![("Host", own.as_str()), ("Authorization", wrong.as_str())], 403),
        (vec![("Host", own.as_str()), ("Authorization", bearer.as_str())], 200),
        // A name that someone else owns and points here.
        (vec![("Host", "evil.example"), ("Authorization", bearer.as_str())], 403),
        // A page of another origin.
        (
            vec![
                ("Host", own.as_str()),
                ("Authorization", bearer.as_str()),
                ("Origin", "http://evil.example"),
            ],
            403,
        ),
    ] {
        let answer = server.sent("GET", "/api/start", &head, "");
        assert_eq!(answer.status, status, "{head:?} {}", answer.body);
        assert!(answer.head.to_lowercase().contains("content-security-policy: default-src 'none'"));
    }
    // The address that is printed: the token becomes a cookie and leaves the address.
    let path = format!("/?token={}", server.token);
    let first = server.sent("GET", &path, &[("Host", &own)], "");
    assert_eq!(first.status, 303);
    let head = first.head.to_lowercase();
    assert!(
        head.contains("location: /\r\n") && head.contains("httponly") && head.contains("samesite=strict")
    );
    assert_eq!(server.sent("GET", "/?token=abc", &[("Host", &own)], "").status, 403);
}

#[test]
fn nothing_outside_the_given_folders_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let (inside, outside) = (dir.path().join("inside"), dir.path().join("outside"));
    std::fs::create_dir_all(&inside).unwrap();
    std::fs::create_dir_all(&outside).unwrap();
    let [setup, _] = measured(&outside);
    measured(&inside);
    std::os::unix::fs::symlink(&setup, inside.join("link.toml")).unwrap();
    let server = Server::started(&[inside], &dir.path().join("state"));
    let files = server.get("/api/start").json()["files"].to_string();
    assert!(files.contains("0/setup.toml") && files.contains("0/phase.csv") && !files.contains("link"));
    for named in [
        "0/../outside/setup.toml",
        "0/link.toml",
        "1/setup.toml",
        "/etc/passwd",
        "0//etc/passwd",
        "0/",
        "",
        "x",
    ] {
        let asked = json!({ "setup": named, "tables": ["0/phase.csv"], "calibration": null });
        let answer = server.post("/api/sessions/open", &asked);
        assert_eq!(answer.status, 403, "{named}: {}", answer.body);
    }
    for id in ["..", "%2e%2e", "..%2f..%2fetc", "nothing"] {
        assert_eq!(server.get(&format!("/api/sessions/{id}")).status, 404, "{id}");
    }
    assert_eq!(server.get("/../Cargo.toml").status, 404);
    let asked = json!({ "setup": "0/setup.toml", "tables": ["0/phase.csv"], "calibration": null });
    assert_eq!(server.post("/api/sessions/open", &asked).status, 200);
}

#[test]
fn two_windows_see_one_session_and_a_new_server_finds_it_again() {
    let dir = tempfile::tempdir().unwrap();
    let given = measured(dir.path());
    let state = dir.path().join("state");
    let server = Server::started(&given, &state);
    let id = server.session.clone().unwrap();
    let news = server.settled(&id);
    assert_eq!(news["phase"], "ready", "{news}");
    assert_eq!(news["inputs"]["tables"], json!(["phase.csv"]));
    let revision = news["revision"].as_u64().unwrap();

    // The second window waits for news; the first adds an effect.
    let step = std::thread::scope(|scope| {
        let waiting = scope.spawn(|| server.get(&format!("/api/sessions/{id}?seen={revision}")).json());
        std::thread::sleep(Duration::from_millis(100));
        let step = server.post(&format!("/api/sessions/{id}/model"), &json!({ "add": "roughness" })).json();
        assert!(waiting.join().unwrap()["revision"].as_u64().unwrap() > revision);
        step
    });
    assert_eq!(step["models"].as_array().unwrap().len(), 2);
    let formula = "name = \"slope\"\nunit = \"mag\"\nvalue = \"a * phase_deg\"\n[parameters]\na = { start = 0.001, unit = \"mag/deg\" }\n";
    let own =
        server.post(&format!("/api/sessions/{id}/formula"), &json!({ "text": formula, "add": true })).json();
    assert_eq!(own["at"], 2);
    // What does not fit is an answer with the place, and changes nothing.
    let broken = formula.replace("phase_deg", "phase_dg");
    let said =
        server.post(&format!("/api/sessions/{id}/formula"), &json!({ "text": broken, "add": false })).json();
    assert!(said["name"].is_null() && said["problem"]["snippet"]["offset"].is_u64(), "{said}");
    // A path does not pass for an effect.
    for named in ["/etc/passwd", "../x.toml", "effects/x.toml", "no_such"] {
        let refused = server.post(&format!("/api/sessions/{id}/model"), &json!({ "add": named }));
        assert_eq!(refused.status, 404, "{}", refused.body);
    }
    // Two windows at once: no step is lost, and the session stays whole.
    std::thread::scope(|scope| {
        for effect in ["opposition_surge", "extinction"] {
            let path = format!("/api/sessions/{id}/model");
            let server = &server;
            scope.spawn(move || server.post(&path, &json!({ "add": effect })).json());
        }
    });
    let both = server.get(&format!("/api/sessions/{id}")).json();
    assert_eq!(both["models"][4].as_array().unwrap().len(), 4, "{}", both["models"]);
    // One goes forth to a model that the other's step drops.
    server.post(&format!("/api/sessions/{id}/model"), &json!({ "at": 1 })).json();
    std::thread::scope(|scope| {
        for step in [json!({ "at": 4 }), json!({ "add": "lommel_seeliger" })] {
            let path = format!("/api/sessions/{id}/model");
            let server = &server;
            scope.spawn(move || assert!([200, 404].contains(&server.post(&path, &step).status)));
        }
    });
    let whole = server.get(&format!("/api/sessions/{id}")).json();
    assert!(whole["at"].as_u64().unwrap() < whole["models"].as_array().unwrap().len() as u64, "{whole}");
    server.settled(&id);
    let at = whole["at"].as_u64().unwrap();
    let before = server.get(&format!("/api/sessions/{id}/models/{at}")).json();

    // Another server on the same folder: as if the first had been killed.
    let again = Server::started(&[], &state);
    assert_eq!(again.get("/api/start").json()["sessions"][0]["id"], json!(id));
    let news = again.settled(&id);
    assert_eq!((&news["at"], &news["models"]), (&whole["at"], &whole["models"]));
    assert_eq!(again.get(&format!("/api/sessions/{id}/models/{at}")).json(), before);
    let undone = again.post(&format!("/api/sessions/{id}/model"), &json!({ "at": 0 })).json();
    assert_eq!(undone["at"], 0);
    let commands = again.get(&format!("/api/sessions/{id}/export/commands.txt"));
    assert!(
        commands.body.contains("retina fit") || commands.body.contains("retina compare"),
        "{}",
        commands.body
    );
}

#[test]
fn files_that_do_not_belong_are_refused_with_what_is_expected() {
    let dir = tempfile::tempdir().unwrap();
    let [setup, table] = measured(dir.path());
    let notes = dir.path().join("notes.toml");
    std::fs::write(&notes, "a = 1\n").unwrap();
    let bound = |paths: &[PathBuf]| {
        let options = ViewOptions { paths: paths.to_vec(), port: 0, state_folder: dir.path().join("state") };
        View::bind(&options)
    };
    for (paths, words) in
        [(vec![dir.path().join("none.csv")], "none.csv"), (vec![setup.clone(), notes], "notes.toml")]
    {
        match bound(&paths) {
            Err(ViewError::Input(error)) => assert!(format!("{error:?}").contains(words), "{error:?}"),
            Err(error) => panic!("{error}"),
            Ok(_) => panic!("{paths:?} was taken"),
        }
    }
    // Dropped files: a table alone, something else, and a body that is too large.
    let server = Server::started(&[], &dir.path().join("state"));
    let dropped = |name: &str, text: &str| {
        server
            .post("/api/sessions/drop", &json!({ "files": [{ "name": name, "text": text }], "beside": null }))
    };
    let alone = dropped("phase.csv", &std::fs::read_to_string(&table).unwrap());
    assert_eq!(alone.status, 422);
    assert!(alone.body.contains("has no setup") && alone.body.contains("retina.setup/1"), "{}", alone.body);
    assert_eq!(dropped("a.csv", "what,is,this\n1,2,3\n").status, 422);
    assert_eq!(server.post("/api/sessions/drop", &json!([1, 2])).status, 422);
}

#[test]
fn panes_answer_for_the_given_paths_alone() {
    let dir = tempfile::tempdir().unwrap();
    let (given, outside) = (dir.path().join("given"), dir.path().join("outside"));
    std::fs::create_dir_all(&given).unwrap();
    std::fs::create_dir_all(outside.join("frames")).unwrap();
    std::fs::write(outside.join("batch.json"), "{}").unwrap();
    std::fs::write(given.join("note.toml"), "a = 1\n").unwrap();
    let server = Server::started(std::slice::from_ref(&given), &dir.path().join("state"));
    for path in [
        "/api/sequence?at=0/../outside",
        "/api/sequence/image/0?at=0/../outside",
        "/api/results?at=1",
        "/api/scene?at=0/../outside/batch.json",
        "/api/optics/designs?at=/etc/passwd",
    ] {
        assert_eq!(server.get(path).status, 403, "{path}");
    }
    #[cfg(unix)]
    {
        let run = given.join("run");
        std::fs::create_dir_all(run.join("truth")).unwrap();
        std::os::unix::fs::symlink("/etc/passwd", run.join("truth/000000.json")).unwrap();
        std::os::unix::fs::symlink(outside.join("frames"), run.join("frames")).unwrap();
        std::fs::write(outside.join("frames/000000.png"), "secret").unwrap();
        for path in ["/api/sequence/truth/0?at=0/run", "/api/sequence/image/0?at=0/run"] {
            let answer = server.get(path);
            assert_eq!(answer.status, 403, "{path}: {}", answer.body);
        }
    }
    let bad = server.get("/api/sequence?at=0");
    assert!(bad.status == 422 && bad.body.contains("no folder that `retina render` wrote"), "{}", bad.body);
    let scene = server.get("/api/scene?at=0/note.toml");
    assert!(scene.status == 422 && scene.body.contains("schema"), "{}", scene.body);
    assert_eq!(server.get("/api/results?at=0").json()["documents"], json!([]));
}

#[test]
fn a_lens_system_follows_its_gaps_and_tilts() {
    let dir = tempfile::tempdir().unwrap();
    let server = Server::started(&[], dir.path());
    let traced = |more: Value| {
        let mut asked = json!({ "at": "reference-1.3fc-wide" });
        asked.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        server.post("/api/optics", &asked)
    };
    let worst = |system: &Value| {
        let fields = system["fields"].as_array().unwrap();
        fields.iter().map(|field| field["rms_um"].as_f64().unwrap()).fold(0.0, f64::max)
    };
    let designed = traced(json!({})).json();
    let last = designed["gaps"].as_array().unwrap().last().unwrap().clone();
    let (surface, gap_mm) = (last["surface"].to_string(), last["designed_mm"].as_f64().unwrap());
    let further = traced(json!({ "gaps_mm": { (surface): gap_mm + 2.0 } })).json();
    assert!(worst(&further) > 1.5 * worst(&designed), "{} {}", worst(&further), worst(&designed));
    let tilted =
        traced(json!({ "groups": { "relay": { "tilt_deg": [2.0, 0.0], "shift_mm": [0.0, 0.0] } } })).json();
    let middle = |system: &Value| system["fields"][0]["centroid_mm"][1].as_f64().unwrap();
    assert!((middle(&tilted) - middle(&designed)).abs() > 0.01, "{}", middle(&tilted));
    assert!(designed["layout"].as_str().unwrap().starts_with("<svg"));
    assert_eq!(traced(json!({ "gaps_mm": { "1": 1.0 } })).status, 404, "a lens is no gap");
    assert_eq!(
        traced(json!({ "groups": { "camera": { "tilt_deg": [0, 0], "shift_mm": [0, 0] } } })).status,
        404
    );
    let negative = traced(json!({ "gaps_mm": { (last["surface"].to_string()): -5.0 } }));
    assert_eq!(negative.status, 422, "{}", negative.body);
}
