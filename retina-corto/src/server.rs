//! The closed loop: poses in by UDP, images out by TCP.
//!
//! Every valid pose gets one image, in the order of arrival: 8 bytes, little-endian, with the PNG's
//! length, then the PNG. What cannot be answered so (a datagram that is no pose, a pose that shows no
//! image, more waiting poses than [`QUEUE`]) is answered with a datagram of text to its sender and
//! gets no image.
//!
//! One client at a time receives images; a new connection takes the place of the old one. An image
//! whose pose arrived while nobody was connected waits for the next client. When a client goes away,
//! the image that was made for it and the waiting poses of its senders are dropped: a simulation
//! that starts again never gets the image of an earlier run.

use std::collections::{HashSet, VecDeque};
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::datagram::decode_pose;
use crate::pose::Pose;

/// Poses that may wait.
const QUEUE: usize = 64;
/// A datagram is read up to here: more than any pose has, so that a longer one is told.
const LONGEST_DATAGRAM: usize = 65_536;
/// How often a thread looks whether it is to end.
const BEAT: Duration = Duration::from_millis(20);
/// A client that takes nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(10);

/// The sockets of a closed loop.
#[derive(Debug)]
pub struct Server {
    poses: UdpSocket,
    images: TcpListener,
}

/// What a server did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ended {
    /// Images sent.
    pub sent: usize,
    /// Datagrams and poses answered with an error.
    pub refused: usize,
}

/// What renders a pose: a PNG, or why there is none.
pub(crate) type Render<'a> = dyn FnMut(&Pose) -> Result<Vec<u8>, String> + 'a;
/// Where a line of the log goes.
pub(crate) type Log<'a> = dyn Fn(&str) + Sync + 'a;

struct Request {
    pose: Pose,
    sender: SocketAddr,
}

struct Client {
    number: u64,
    stream: TcpStream,
    /// Senders of the poses that were rendered for it.
    senders: HashSet<SocketAddr>,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Request>,
    client: Option<Client>,
    clients_so_far: u64,
    refused: usize,
}

struct Shared<'a> {
    state: Mutex<State>,
    changed: Condvar,
    ended: AtomicBool,
    stop: &'a AtomicBool,
    log: &'a Log<'a>,
    poses: &'a UdpSocket,
    images: &'a TcpListener,
}

impl Server {
    /// Opens the sockets; port 0 stands for any free one.
    ///
    /// # Errors
    /// An address that cannot be used.
    pub fn bind(listen: IpAddr, pose_port: u16, image_port: u16) -> std::io::Result<Self> {
        let poses = UdpSocket::bind((listen, pose_port))?;
        let images = TcpListener::bind((listen, image_port))?;
        poses.set_read_timeout(Some(BEAT))?;
        images.set_nonblocking(true)?;
        Ok(Self { poses, images })
    }

    /// Where poses are received.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn pose_address(&self) -> std::io::Result<SocketAddr> {
        self.poses.local_addr()
    }

    /// Where clients connect.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn image_address(&self) -> std::io::Result<SocketAddr> {
        self.images.local_addr()
    }

    /// Serves until `stop` is set or `frames` images are sent. `log` is told of clients and errors.
    pub fn run(&self, render: &mut Render<'_>, frames: Option<usize>, stop: &AtomicBool, log: &Log) -> Ended {
        let shared = Shared {
            state: Mutex::default(),
            changed: Condvar::new(),
            ended: AtomicBool::new(false),
            stop,
            log,
            poses: &self.poses,
            images: &self.images,
        };
        std::thread::scope(|scope| {
            scope.spawn(|| shared.receive(scope));
            scope.spawn(|| shared.accept(scope));
            let sent = shared.answer(render, frames);
            shared.ended.store(true, Ordering::Release);
            Ended { sent, refused: shared.lock().refused }
        })
    }
}

impl Shared<'_> {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_over(&self) -> bool {
        self.ended.load(Ordering::Acquire) || self.stop.load(Ordering::Acquire)
    }

    /// Waits until the state is as wanted; `None` when it is over before.
    fn wait_for<T>(&self, mut wanted: impl FnMut(&mut State) -> Option<T>) -> Option<T> {
        let mut state = self.lock();
        loop {
            if self.is_over() {
                return None;
            }
            if let Some(found) = wanted(&mut state) {
                return Some(found);
            }
            state = self.changed.wait_timeout(state, BEAT).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Tells a sender why it gets no image.
    fn refuse(&self, sender: SocketAddr, reason: &str) {
        self.lock().refused += 1;
        (self.log)(&format!("no image for {sender}: {reason}"));
        // Nobody may listen there any more.
        let _ = self.poses.send_to(format!("retina: error: {reason}").as_bytes(), sender);
    }

    /// Receives poses.
    fn receive<'scope, 'env>(&'scope self, scope: &'scope std::thread::Scope<'scope, 'env>) {
        let mut buffer = [0; LONGEST_DATAGRAM];
        while !self.is_over() {
            // A time-out, or what the system passes on of a reply that nobody took.
            let Ok((size, sender)) = self.poses.recv_from(&mut buffer) else { continue };
            match decode_pose(&buffer[..size]) {
                Err(error) => self.refuse(sender, &error.to_string()),
                Ok(pose) => {
                    // Who has connected before this pose was sent is its client: the poses that go with the old
                    // client's leaving are those before it.
                    while self.accept_one(scope) {}
                    let mut state = self.lock();
                    if state.waiting.len() < QUEUE {
                        state.waiting.push_back(Request { pose, sender });
                        self.changed.notify_all();
                    } else {
                        drop(state);
                        self.refuse(sender, &format!("{QUEUE} poses are waiting, which is the most"));
                    }
                }
            }
        }
    }

    /// Accepts clients.
    fn accept<'scope, 'env>(&'scope self, scope: &'scope std::thread::Scope<'scope, 'env>) {
        while !self.is_over() {
            if !self.accept_one(scope) {
                std::thread::sleep(BEAT);
            }
        }
    }

    /// Accepts a client that has connected, if one has; it gets a thread that sees it go.
    fn accept_one<'scope, 'env>(&'scope self, scope: &'scope std::thread::Scope<'scope, 'env>) -> bool {
        // Under the lock: who is accepted is also in the state before anyone looks for a further one.
        let mut state = self.lock();
        let Ok((stream, address)) = self.images.accept() else { return false };
        let watched = stream
            .set_nonblocking(false)
            .and_then(|()| stream.set_nodelay(true))
            .and_then(|()| stream.set_read_timeout(Some(BEAT)))
            .and_then(|()| stream.set_write_timeout(Some(PATIENCE)))
            .and_then(|()| stream.try_clone());
        let Ok(watched) = watched else { return true };
        let old = state.client.as_ref().map(|client| client.number);
        if let Some(old) = old {
            leave(&mut state, old);
        }
        state.clients_so_far += 1;
        let number = state.clients_so_far;
        state.client = Some(Client { number, stream, senders: HashSet::new() });
        self.changed.notify_all();
        drop(state);
        if old.is_some() {
            (self.log)("a new client takes the place of the connected one");
        }
        (self.log)(&format!("client {address} is connected"));
        scope.spawn(move || self.watch(number, watched));
        true
    }

    /// Reads what a client has no reason to send, to see it go.
    fn watch(&self, number: u64, mut stream: TcpStream) {
        let mut buffer = [0; 256];
        while !self.is_over() && self.lock().client.as_ref().is_some_and(|client| client.number == number) {
            match stream.read(&mut buffer) {
                Ok(1..) => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Ok(0) | Err(_) => {
                    if leave(&mut self.lock(), number) {
                        (self.log)("the client is gone");
                    }
                }
            }
        }
    }

    /// Renders poses and sends their images; gives the number sent.
    fn answer(&self, render: &mut Render<'_>, frames: Option<usize>) -> usize {
        let mut sent = 0;
        while frames.is_none_or(|frames| sent < frames) {
            let taken = self.wait_for(|state| {
                let request = state.waiting.pop_front()?;
                let client = state.client.as_mut().map(|client| {
                    client.senders.insert(request.sender);
                    client.number
                });
                Some((request, client))
            });
            let Some((request, made_for)) = taken else { break };
            match render(&request.pose) {
                Err(reason) => self.refuse(request.sender, &reason),
                Ok(png) => match self.send(&png, made_for) {
                    Some(true) => sent += 1,
                    Some(false) => (self.log)("an image is dropped: its client is gone"),
                    None => break,
                },
            }
        }
        sent
    }

    /// Sends an image to the client it was made for, or to the next one where there was none.
    /// `None` when it is over before, `false` when that client is gone.
    fn send(&self, png: &[u8], made_for: Option<u64>) -> Option<bool> {
        let to = self.wait_for(|state| match (&state.client, made_for) {
            (Some(client), None) => Some(Some((client.number, client.stream.try_clone()))),
            (None, None) => None,
            (Some(client), Some(number)) if client.number == number => {
                Some(Some((number, client.stream.try_clone())))
            }
            (_, Some(_)) => Some(None),
        })?;
        let Some((number, stream)) = to else { return Some(false) };
        let written = stream.and_then(|mut stream| {
            let mut message = (png.len() as u64).to_le_bytes().to_vec();
            message.extend_from_slice(png);
            stream.write_all(&message)
        });
        if written.is_ok() {
            return Some(true);
        }
        if leave(&mut self.lock(), number) {
            (self.log)("the client is gone");
        }
        Some(false)
    }
}

/// Ends a client's session: its connection, and the waiting poses of its senders. `false` when it
/// had ended already.
fn leave(state: &mut State, number: u64) -> bool {
    match state.client.take_if(|client| client.number == number) {
        None => false,
        Some(client) => {
            state.waiting.retain(|request| !client.senders.contains(&request.sender));
            // The client may be gone already.
            let _ = client.stream.shutdown(std::net::Shutdown::Both);
            true
        }
    }
}
