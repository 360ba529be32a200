//! The closed loop over real sockets, with a renderer that returns the pose as text: order, errors,
//! clients that come late, go and come back.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::io::Read as _;
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use retina_corto::{Ended, Pose, Server};

/// Far longer than anything here takes.
const LONG: Duration = Duration::from_secs(20);

struct Loop {
    poses: SocketAddr,
    images: SocketAddr,
    stop: Arc<AtomicBool>,
    log: Arc<Mutex<Vec<String>>>,
    thread: Option<JoinHandle<Ended>>,
}

impl Loop {
    /// A server whose image is "image X" for a camera at x = X; a negative x fails, 1000 is slow.
    fn start() -> Self {
        let server = Server::bind(Ipv4Addr::LOCALHOST.into(), 0, 0).unwrap();
        let (poses, images) = (server.pose_address().unwrap(), server.image_address().unwrap());
        let (stop, log) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Vec::new())));
        let (flag, lines) = (Arc::clone(&stop), Arc::clone(&log));
        let thread = std::thread::spawn(move || {
            let mut render = |pose: &Pose| {
                let x = pose.camera.position_bu.x;
                if x == 1000.0 {
                    std::thread::sleep(Duration::from_millis(300));
                }
                if x < 0.0 { Err(format!("nothing at {x}")) } else { Ok(format!("image {x}").into_bytes()) }
            };
            server.run(&mut render, None, &flag, &|text| lines.lock().unwrap().push(text.to_owned()))
        });
        Self { poses, images, stop, log, thread: Some(thread) }
    }

    fn sender(&self) -> UdpSocket {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        socket.connect(self.poses).unwrap();
        socket.set_read_timeout(Some(LONG)).unwrap();
        socket
    }

    fn client(&self) -> TcpStream {
        let stream = TcpStream::connect(self.images).unwrap();
        stream.set_read_timeout(Some(LONG)).unwrap();
        stream
    }

    fn wait_for_log(&self, words: &str, times: usize) {
        let start = Instant::now();
        while self.log.lock().unwrap().iter().filter(|line| line.contains(words)).count() < times {
            assert!(start.elapsed() < LONG, "{words}: {:?}", self.log.lock().unwrap());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn end(mut self) -> Ended {
        self.stop.store(true, Ordering::Release);
        self.thread.take().unwrap().join().unwrap()
    }
}

/// A pose with the camera at x, 17 values.
fn pose(x: f64) -> Vec<u8> {
    let values = [0., 0., 1., x, 0., 0., 1., 0., 0., 0., 0., 0., 0., 1., 0., 0., 0.];
    values.iter().flat_map(|value: &f64| value.to_be_bytes()).collect()
}

fn image(client: &mut TcpStream) -> String {
    let mut length = [0; 8];
    client.read_exact(&mut length).unwrap();
    let mut bytes = vec![0; u64::from_le_bytes(length) as usize];
    client.read_exact(&mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

fn reply(sender: &UdpSocket) -> String {
    let mut buffer = [0; 2048];
    let size = sender.recv(&mut buffer).unwrap();
    String::from_utf8(buffer[..size].to_vec()).unwrap()
}

#[test]
fn poses_are_answered_in_order_whether_the_client_comes_before_or_after() {
    let server = Loop::start();
    let sender = server.sender();
    sender.send(&pose(1.0)).unwrap();
    sender.send(&pose(2.0)).unwrap();
    let mut client = server.client();
    assert_eq!((image(&mut client), image(&mut client)), ("image 1".into(), "image 2".into()));
    for x in 3..20 {
        sender.send(&pose(f64::from(x))).unwrap();
    }
    for x in 3..20 {
        assert_eq!(image(&mut client), format!("image {x}"));
    }
    assert_eq!(server.end(), Ended { sent: 19, refused: 0 });
}

#[test]
fn what_is_no_pose_is_answered_with_an_error_and_the_server_lives_on() {
    let server = Loop::start();
    let (sender, mut client) = (server.sender(), server.client());
    let with = |index: usize, value: f64| {
        let mut bytes = pose(1.0);
        bytes[8 * index..8 * index + 8].copy_from_slice(&value.to_be_bytes());
        bytes
    };
    let cases = [
        (vec![], "found 0 bytes, expected 136 or 168"),
        (vec![7; 135], "found 135 bytes"),
        (vec![7; 169], "found 169 bytes"),
        (vec![7; 60_000], "found 60000 bytes"),
        (with(3, f64::NAN), "value 3 of the pose is not finite"),
        (with(6, 2.0), "the quaternion of the camera is not unit"),
        (pose(-5.0), "nothing at -5"),
    ];
    for (bytes, words) in &cases {
        sender.send(bytes).unwrap();
        let text = reply(&sender);
        assert!(text.starts_with("retina: error: ") && text.contains(words), "{text}");
    }
    sender.send(&pose(4.0)).unwrap();
    assert_eq!(image(&mut client), "image 4");
    assert_eq!(server.end(), Ended { sent: 1, refused: cases.len() });
}

#[test]
fn a_simulation_that_starts_again_gets_no_image_of_the_run_before() {
    let server = Loop::start();
    let (sender, client) = (server.sender(), server.client());
    server.wait_for_log("is connected", 1);
    // One that is being rendered and one that waits.
    sender.send(&pose(1000.0)).unwrap();
    sender.send(&pose(1.0)).unwrap();
    std::thread::sleep(Duration::from_millis(100));
    client.shutdown(Shutdown::Both).unwrap();
    drop(client);
    server.wait_for_log("the client is gone", 1);
    let (again, mut client) = (server.sender(), server.client());
    again.send(&pose(2.0)).unwrap();
    assert_eq!(image(&mut client), "image 2");
    assert_eq!(server.end().sent, 1);
}

#[test]
fn a_new_client_takes_the_place_of_the_old() {
    let server = Loop::start();
    let mut old = server.client();
    server.wait_for_log("is connected", 1);
    let mut new = server.client();
    server.wait_for_log("takes the place", 1);
    server.wait_for_log("is connected", 2);
    assert_eq!(old.read(&mut [0; 8]).unwrap_or(0), 0);
    server.sender().send(&pose(3.0)).unwrap();
    assert_eq!(image(&mut new), "image 3");
    server.end();
}

#[test]
fn too_many_poses_are_refused_and_the_others_answered() {
    let server = Loop::start();
    let (sender, mut client) = (server.sender(), server.client());
    server.wait_for_log("is connected", 1);
    sender.send(&pose(1000.0)).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    for x in 0..65 {
        sender.send(&pose(f64::from(x))).unwrap();
    }
    assert!(reply(&sender).contains("64 poses are waiting"));
    assert_eq!(image(&mut client), "image 1000");
    for x in 0..64 {
        assert_eq!(image(&mut client), format!("image {x}"));
    }
    server.end();
}

#[test]
fn a_client_that_comes_back_and_sends_at_once_gets_its_image_each_time() {
    let server = Loop::start();
    let sender = server.sender();
    let mut open = Vec::new();
    for round in 0..20 {
        // Its old connection is closed, or still open, which it has from the round before.
        let mut client = server.client();
        client.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        sender.send(&pose(f64::from(round))).unwrap();
        assert_eq!(image(&mut client), format!("image {round}"));
        if round % 2 == 1 {
            open.push(client);
        }
    }
    assert_eq!(server.end(), Ended { sent: 20, refused: 0 });
}
