//! The protocol of `vizInterface`: a ZeroMQ REQ socket on the simulation's side, REP here.
//!
//! | request | reply |
//! |---|---|
//! | `PING` | `PONG` |
//! | `SIM_UPDATE`, two empty frames, a serialized `VizMessage` | `OK`, or `ERROR` |
//! | `REQUEST_IMAGE_n` | the PNG's length, 4 bytes, most significant first; the PNG. Without an image: length 0 |
//! | `REQUEST_INPUT` (live stream) | `VIZARD_INPUT`, an empty message: nobody sits at a keyboard |

use std::net::{IpAddr, SocketAddr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use prost::bytes::Bytes;
use tokio::runtime::Runtime;
use zeromq::{Endpoint, RepSocket, Socket as _, SocketRecv as _, SocketSend as _, ZmqError, ZmqMessage};

use crate::view::{Simulation, View};

/// How often the loop looks whether it is to end.
const BEAT: Duration = Duration::from_millis(50);
const REQUEST_IMAGE: &str = "REQUEST_IMAGE_";

/// A socket that a simulation connects to.
pub struct Server {
    runtime: Runtime,
    socket: RepSocket,
    address: SocketAddr,
}

/// What a server did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ended {
    /// Images sent.
    pub sent: usize,
    /// Requests for an image without one.
    pub refused: usize,
}

impl Server {
    /// Opens the socket; port 0 stands for any free one.
    ///
    /// # Errors
    /// An address that cannot be used.
    pub fn bind(listen: IpAddr, port: u16) -> std::io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let mut socket = RepSocket::new();
        let wanted = format!("tcp://{}", SocketAddr::new(listen, port));
        let bound = runtime.block_on(socket.bind(&wanted)).map_err(std::io::Error::other)?;
        let address = match bound {
            Endpoint::Tcp(_, port) => SocketAddr::new(listen, port),
            other => return Err(std::io::Error::other(format!("bound to {other} instead of {wanted}"))),
        };
        Ok(Self { runtime, socket, address })
    }

    /// Where simulations connect.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `stop` is set or `frames` images are sent. `body_names` are those that views hold, `render` makes the
    /// PNG of one, `log` is told what could not be done.
    pub fn run(
        &mut self,
        body_names: &[String],
        render: &mut dyn FnMut(&View) -> Result<Vec<u8>, String>,
        frames: Option<usize>,
        stop: &AtomicBool,
        log: &dyn Fn(&str),
    ) -> Ended {
        let Self { runtime, socket, .. } = self;
        let mut simulation = Simulation::default();
        let mut ended = Ended::default();
        while !stop.load(Ordering::Acquire) && frames.is_none_or(|frames| ended.sent < frames) {
            let next = async { tokio::time::timeout(BEAT, socket.recv()).await };
            let request = match runtime.block_on(next) {
                Err(_) => continue,
                Ok(Ok(request)) => request.into_vec(),
                // A client that is gone has its place taken by the next.
                Ok(Err(ZmqError::NoMessage)) => continue,
                Ok(Err(error)) => {
                    log(&format!("a client is gone: {error}"));
                    continue;
                }
            };
            let words = request.first().map(|first| String::from_utf8_lossy(first).into_owned());
            let reply = match words.as_deref().unwrap_or_default() {
                "PING" => vec![b"PONG".to_vec()],
                "SIM_UPDATE" => match simulation.update(request.last().map_or(&[][..], |bytes| bytes)) {
                    Ok(()) => vec![b"OK".to_vec()],
                    Err(why) => {
                        log(&why);
                        vec![b"ERROR".to_vec()]
                    }
                },
                "REQUEST_INPUT" => vec![b"VIZARD_INPUT".to_vec(), Vec::new()],
                other => match other.strip_prefix(REQUEST_IMAGE) {
                    Some(number) => {
                        let made = number
                            .parse()
                            .map_err(|_| format!("`{other}` names no camera by its number"))
                            .and_then(|camera| simulation.view(camera, body_names))
                            .and_then(|view| render(&view));
                        let png = made.unwrap_or_else(|why| {
                            log(&why);
                            Vec::new()
                        });
                        ended.sent += usize::from(!png.is_empty());
                        ended.refused += usize::from(png.is_empty());
                        vec![(png.len() as u32).to_be_bytes().to_vec(), png]
                    }
                    None => {
                        log(&format!("a request that is not known: `{other}`"));
                        vec![b"ERROR".to_vec()]
                    }
                },
            };
            let parts: Vec<Bytes> = reply.into_iter().map(Bytes::from).collect();
            let Ok(message) = ZmqMessage::try_from(parts) else { continue };
            if let Err(error) = runtime.block_on(socket.send(message)) {
                log(&format!("a client left without its answer: {error}"));
            }
        }
        ended
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use prost::Message as _;
    use zeromq::ReqSocket;

    use super::*;
    use crate::view::tests::state;

    /// A client that asks in vizInterface's order gets its answers; one that comes after it as well.
    #[test]
    fn a_simulation_gets_its_images() {
        let mut server = Server::bind(Ipv4Addr::LOCALHOST.into(), 0).unwrap();
        let address = server.address();
        let client = std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(async {
                let mut answers = Vec::new();
                for _ in 0..2 {
                    let mut socket = ReqSocket::new();
                    socket.connect(&format!("tcp://{address}")).await.unwrap();
                    let state = state().encode_to_vec();
                    let update = vec![b"SIM_UPDATE".to_vec(), Vec::new(), Vec::new(), state];
                    for request in [
                        vec![b"PING".to_vec()],
                        update,
                        vec![b"REQUEST_IMAGE_3".to_vec()],
                        vec![b"REQUEST_INPUT".to_vec()],
                        vec![b"SING".to_vec()],
                        vec![b"REQUEST_IMAGE_7".to_vec()],
                    ] {
                        let parts: Vec<Bytes> = request.into_iter().map(Bytes::from).collect();
                        socket.send(ZmqMessage::try_from(parts).unwrap()).await.unwrap();
                        let answer = socket.recv().await.unwrap().into_vec();
                        answers.push(answer.iter().map(|part| part.to_vec()).collect::<Vec<_>>());
                    }
                }
                answers
            })
        });
        let told = std::sync::Mutex::new(Vec::new());
        let ended = server.run(
            &["moon".to_owned()],
            &mut |view| Ok(vec![view.camera_id as u8; 258]),
            Some(2),
            &AtomicBool::new(false),
            &|text| told.lock().unwrap().push(text.to_owned()),
        );
        assert_eq!(ended, Ended { sent: 2, refused: 2 });
        let answers = client.join().unwrap();
        for answers in answers.chunks(6) {
            assert_eq!(answers[0], [b"PONG"]);
            assert_eq!(answers[1], [b"OK"]);
            assert_eq!(answers[2], [vec![0; 4], Vec::new()]);
            assert_eq!(answers[3], [b"VIZARD_INPUT".to_vec(), Vec::new()]);
            assert_eq!(answers[4], [b"ERROR"]);
            assert_eq!(answers[5], [vec![0, 0, 1, 2], vec![7; 258]]);
        }
        assert!(told.lock().unwrap().iter().any(|text| text.contains("no camera 3; it has 7")));
    }
}
