//! The protocol of `vizInterface`: a ZeroMQ REQ socket on the simulation's side, REP here.
//!
//! | request | reply |
//! |---|---|
//! | `PING` | `PONG` |
//! | `SIM_UPDATE`, two empty frames, a serialized `VizMessage` | `OK`, or `ERROR` |
//! | `REQUEST_IMAGE_n` | the PNG's length, 4 bytes, most significant first; the PNG. Without an image: length 0 |
//! | `REQUEST_INPUT` (live stream) | `VIZARD_INPUT`, an empty message: nobody sits at a keyboard |

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use crate::view::{Simulation, View};
use crate::zmtp::Connection;

/// How often the loop looks for a client and whether it is to end.
const BEAT: Duration = Duration::from_millis(20);
const REQUEST_IMAGE: &str = "REQUEST_IMAGE_";
/// Simulations that may be connected at once. Basilisk leaves its socket open when a simulation ends, until its program ends.
const MOST_CLIENTS: usize = 64;
/// Of a request that is not known, so much is told.
const TOLD_CHARACTERS: usize = 40;

/// A socket that simulations connect to; each has a state of its own.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
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
        let listener = TcpListener::bind((listen, port))?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener })
    }

    /// Where simulations connect.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Serves until `stop` is set or `frames` images are sent. `body_names` are those that views hold, `render` makes the
    /// PNG of one, `log` is told what could not be done.
    pub fn run(
        &self,
        body_names: &[String],
        render: &mut dyn FnMut(&View) -> Result<Vec<u8>, String>,
        frames: Option<usize>,
        stop: &AtomicBool,
        log: &(dyn Fn(&str) + Sync),
    ) -> Ended {
        let mut ended = Ended::default();
        let over = AtomicBool::new(false);
        let clients = AtomicUsize::new(0);
        let (asked, wanted) = mpsc::channel::<Asked>();
        std::thread::scope(|scope| {
            while !stop.load(Ordering::Acquire) && frames.is_none_or(|frames| ended.sent < frames) {
                if clients.load(Ordering::Acquire) < MOST_CLIENTS
                    && let Ok((stream, _)) = self.listener.accept()
                {
                    clients.fetch_add(1, Ordering::AcqRel);
                    let (asked, over, clients) = (asked.clone(), &over, &clients);
                    scope.spawn(move || {
                        match serve(stream, body_names, &asked, over, log) {
                            // It has gone, or the program ends.
                            Err(error)
                                if matches!(
                                    error.kind(),
                                    ErrorKind::UnexpectedEof | ErrorKind::Interrupted
                                ) => {}
                            Err(error) => log(&format!("a client is left: {error}")),
                            Ok(()) => {}
                        }
                        clients.fetch_sub(1, Ordering::AcqRel);
                    });
                }
                let Ok(Asked { view, reply }) = wanted.recv_timeout(BEAT) else { continue };
                let png = view.and_then(|view| render(&view)).unwrap_or_else(|why| {
                    log(&why);
                    Vec::new()
                });
                ended.sent += usize::from(!png.is_empty());
                ended.refused += usize::from(png.is_empty());
                let (sent, done) = mpsc::channel();
                // A client that has left in the meantime wants none. The last image is sent before the program ends.
                if reply.send((png, sent)).is_ok() {
                    let _ = done.recv();
                }
            }
            over.store(true, Ordering::Release);
        });
        ended
    }
}

/// A client's wish for an image: of a view, or why there is none; and the way back, with one to say that it is sent.
struct Asked {
    view: Result<View, String>,
    reply: mpsc::Sender<(Vec<u8>, mpsc::Sender<()>)>,
}

/// Answers one simulation until it goes.
fn serve(
    stream: TcpStream,
    body_names: &[String],
    asked: &mpsc::Sender<Asked>,
    over: &AtomicBool,
    log: &(dyn Fn(&str) + Sync),
) -> std::io::Result<()> {
    let mut client = Connection::open(stream, over)?;
    let mut simulation = Simulation::default();
    loop {
        let request = client.receive()?;
        let words = request.first().map(|first| String::from_utf8_lossy(first)).unwrap_or_default();
        let answer = match words.as_ref() {
            "PING" => vec![b"PONG".to_vec()],
            "SIM_UPDATE" => match simulation.update(request.last().map_or(&[][..], |bytes| bytes)) {
                Ok(()) => vec![b"OK".to_vec()],
                Err(why) => {
                    log(&why);
                    vec![b"ERROR".to_vec()]
                }
            },
            "REQUEST_INPUT" => vec![b"VIZARD_INPUT".to_vec(), Vec::new()],
            other => {
                let told: String = other.chars().take(TOLD_CHARACTERS).collect();
                if let Some(number) = other.strip_prefix(REQUEST_IMAGE) {
                    let view = number
                        .parse()
                        .map_err(|_| format!("{told:?} names no camera by its number"))
                        .and_then(|camera| simulation.view(camera, body_names));
                    let (reply, made) = mpsc::channel();
                    let ends = |_| std::io::Error::from(ErrorKind::Interrupted);
                    asked.send(Asked { view, reply }).map_err(|_| ErrorKind::Interrupted)?;
                    let (png, sent) = made.recv().map_err(ends)?;
                    let answer = [(png.len() as u32).to_be_bytes().to_vec(), png];
                    client.send(&answer)?;
                    let _ = sent.send(());
                    continue;
                }
                log(&format!("a request that is not known: {told:?}"));
                vec![b"ERROR".to_vec()]
            }
        };
        client.send(&answer)?;
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};
    use std::net::Ipv4Addr;

    use prost::Message as _;

    use super::*;
    use crate::view::tests::state;

    /// A REQ socket's side, byte by byte as libzmq has it.
    struct Client(TcpStream);

    impl Client {
        fn connect(address: SocketAddr) -> Self {
            let mut stream = TcpStream::connect(address).unwrap();
            let mut greeting = [0; 64];
            (greeting[0], greeting[8], greeting[9], greeting[10]) = (0xff, 1, 0x7f, 3);
            greeting[12..16].copy_from_slice(b"NULL");
            stream.write_all(&greeting).unwrap();
            stream
                .write_all(b"\x04\x26\x05READY\x0bSocket-Type\x00\x00\x00\x03REQ\x08Identity\x00\x00\x00\x00")
                .unwrap();
            let mut theirs = [0; 64];
            stream.read_exact(&mut theirs).unwrap();
            let mut out = Self(stream);
            assert_eq!(out.frame().1, b"\x05READY\x0bSocket-Type\x00\x00\x00\x03REP");
            out
        }

        fn frame(&mut self) -> (u8, Vec<u8>) {
            let mut head = [0; 2];
            self.0.read_exact(&mut head).unwrap();
            let size = if head[0] & 2 != 0 {
                let mut rest = [0; 7];
                self.0.read_exact(&mut rest).unwrap();
                rest.iter().fold(u64::from(head[1]), |size, byte| size << 8 | u64::from(*byte))
            } else {
                u64::from(head[1])
            };
            let mut body = vec![0; size as usize];
            self.0.read_exact(&mut body).unwrap();
            (head[0], body)
        }

        fn ask(&mut self, parts: &[&[u8]]) -> Vec<Vec<u8>> {
            self.0.write_all(&[1, 0]).unwrap();
            for (at, part) in parts.iter().enumerate() {
                let more = u8::from(at + 1 < parts.len());
                self.0.write_all(&[more | 2]).unwrap();
                self.0.write_all(&(part.len() as u64).to_be_bytes()).unwrap();
                self.0.write_all(part).unwrap();
            }
            let mut out = vec![self.frame()];
            while out.last().unwrap().0 & 1 != 0 {
                out.push(self.frame());
            }
            assert!(out.remove(0).1.is_empty());
            out.into_iter().map(|(_, body)| body).collect()
        }
    }

    /// Two simulations one after another get the answers to their own states, whatever connects between them.
    #[test]
    fn simulations_get_their_images_and_strangers_nothing() {
        let server = Server::bind(Ipv4Addr::LOCALHOST.into(), 0).unwrap();
        let address = server.address().unwrap();
        let clients = std::thread::spawn(move || {
            let mut kept = Vec::new();
            for turn in 0..2 {
                let mut client = Client::connect(address);
                assert_eq!(client.ask(&[b"PING"]), [b"PONG"]);
                // Nothing of the simulation before.
                assert_eq!(client.ask(&[b"REQUEST_IMAGE_7"]), [vec![0; 4], Vec::new()], "{turn}");
                assert_eq!(client.ask(&[b"SIM_UPDATE", b"", b"", &state().encode_to_vec()]), [b"OK"]);
                assert_eq!(client.ask(&[b"SIM_UPDATE", b"", b"", &[0xff; 9]]), [b"ERROR"]);
                assert_eq!(client.ask(&[b"REQUEST_IMAGE_3"]), [vec![0; 4], Vec::new()]);
                assert_eq!(client.ask(&[b"REQUEST_INPUT"]), [b"VIZARD_INPUT".to_vec(), Vec::new()]);
                assert_eq!(client.ask(&[&[b'S'; 100_000]]), [b"ERROR"]);
                assert_eq!(client.ask(&[b"REQUEST_IMAGE_7"]), [vec![0, 0, 1, 2], vec![7; 258]]);
                // Basilisk leaves its sockets open.
                kept.push(client);
                if turn == 0 {
                    TcpStream::connect(address).unwrap().write_all(&[b'G'; 200]).unwrap();
                    // A frame that says to have 2^62 bytes.
                    let mut large = Client::connect(address).0;
                    large.write_all(&[2, 0x40, 0, 0, 0, 0, 0, 0, 0]).unwrap();
                    assert_eq!(large.read(&mut [0; 8]).unwrap_or(0), 0);
                    let mut many = Client::connect(address).0;
                    many.write_all(&[1, 0].repeat(1000)).unwrap();
                    assert_eq!(many.read(&mut [0; 8]).unwrap_or(0), 0);
                }
            }
        });
        let told = std::sync::Mutex::new(Vec::new());
        let ended = server.run(
            &["moon".to_owned()],
            &mut |view| Ok(vec![view.camera_id as u8; 258]),
            Some(2),
            &AtomicBool::new(false),
            &|text| told.lock().unwrap().push(text.to_owned()),
        );
        assert_eq!(ended, Ended { sent: 2, refused: 4 });
        clients.join().unwrap();
        let told = told.into_inner().unwrap();
        let said = |part: &str| told.iter().any(|text| text.contains(part));
        assert!(said("no camera 3; it has 7") && said("no ZeroMQ socket") && said("more than"), "{told:?}");
        assert!(told.iter().all(|text| text.len() < 200), "{told:?}");
    }
}
