//! The device: its sockets and threads.

use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use socket2::{Domain, Protocol, Socket, Type};

use crate::acquisition;
use crate::control::{Action, Control};
use crate::imager::{CameraInfo, Imager};
use crate::stream::{Block, test_packet, unavailable};

/// Port of control packets.
const PORT: u16 = 3956;
/// Time after which a waiting socket looks whether the device ends.
const LOOK: Duration = Duration::from_millis(50);
/// Images that are kept for packets that get lost.
const KEPT: usize = 6;
/// Most packets that one request brings again.
const MOST_RESENT: u32 = 4096;

/// Why there is no device.
#[derive(Debug, thiserror::Error)]
pub enum GigeError {
    /// Another device has the address.
    #[error("{address} already has a GigE Vision device (port {PORT})")]
    InUse {
        /// The address.
        address: Ipv4Addr,
    },
    /// The address is not this machine's, or its sockets are refused.
    #[error("cannot open a GigE Vision device at {address}: {source}")]
    Socket {
        /// The address.
        address: Ipv4Addr,
        /// What the system says.
        source: io::Error,
    },
}

/// What a device has done.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Statistics {
    /// Images taken.
    pub taken: u64,
    /// Of these, images sent; the others had no destination.
    pub sent: u64,
    /// Packets sent again on request.
    pub resent_packets: u64,
    /// Packets that were asked for and are not kept any more.
    pub unavailable_packets: u64,
    /// Images that the imager could not make.
    pub failed: u64,
    /// What the imager said of the last of them.
    pub last_failure: Option<String>,
}

/// A GigE Vision device on a network address; ends when it is dropped.
pub struct Camera {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

pub(crate) struct Shared {
    pub(crate) info: CameraInfo,
    control: Mutex<Control>,
    /// A command has changed what the acquisition waits for.
    pub(crate) changed: Condvar,
    stopping: AtomicBool,
    is_loopback: bool,
    stream: UdpSocket,
    recent: Mutex<VecDeque<Arc<Block>>>,
    statistics: Mutex<Statistics>,
}

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    pub(crate) fn control(&self) -> MutexGuard<'_, Control> {
        held(&self.control)
    }

    pub(crate) fn statistics(&self) -> MutexGuard<'_, Statistics> {
        held(&self.statistics)
    }

    pub(crate) fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }

    /// Keeps an image for resending.
    pub(crate) fn keep(&self, block: Arc<Block>) {
        let mut recent = held(&self.recent);
        recent.push_back(block);
        while recent.len() > KEPT {
            recent.pop_front();
        }
    }

    /// Sends a packet of the stream. What the system cannot send is lost, as on a wire; the client asks again.
    pub(crate) fn send(&self, packet: &[u8], to: SocketAddr) {
        let _ = self.stream.send_to(packet, to);
    }

    fn act(&self, action: Action, from: SocketAddr) {
        let (to, packet_bytes) = {
            let control = self.control();
            (control.destination(), control.bootstrap.packet_bytes() as usize)
        };
        let Some(to) = to else { return };
        match action {
            Action::TestPacket => self.send(&test_packet(packet_bytes), to),
            // Only for the one who receives the stream: nobody else can make the device send.
            Action::Resend { .. } if from.ip() != to.ip() => {}
            Action::Resend { block, first, last } => {
                let found = held(&self.recent).iter().find(|kept| kept.id == block).cloned();
                let last = last.min(first.saturating_add(MOST_RESENT));
                for number in first..=last {
                    match found.as_ref().map(|kept| kept.packet(number)) {
                        Some(Some(packet)) => {
                            self.statistics().resent_packets += 1;
                            self.send(&packet, to);
                        }
                        // Beyond the image's last packet.
                        Some(None) => break,
                        None => {
                            self.statistics().unavailable_packets += 1;
                            self.send(&unavailable(block, number), to);
                            break;
                        }
                    }
                }
            }
        }
    }

    /// Answers what comes to a socket until the device ends.
    fn listen(&self, socket: &UdpSocket, answers: &UdpSocket, only_discovery: bool) {
        let mut packet = [0; 2048];
        while !self.is_stopping() {
            let Ok((size, from)) = socket.recv_from(&mut packet) else {
                // Nothing came for a while; or the system reports an earlier answer that was not taken.
                self.control().release_silent(Instant::now());
                continue;
            };
            // A broadcast is heard from every network of the machine. One from where images cannot be sent to is not ours.
            if only_discovery && from.ip().is_loopback() != self.is_loopback {
                continue;
            }
            let outcome = self.control().handle(&packet[..size], from, only_discovery, Instant::now());
            self.changed.notify_all();
            if let Some(answer) = outcome.answer {
                let _ = answers.send_to(&answer, from);
            }
            if let Some(action) = outcome.action {
                self.act(action, from);
            }
        }
    }
}

/// A socket that hears what is sent to a broadcast address; several devices of one machine share it.
fn broadcast_socket(address: Ipv4Addr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    socket.set_broadcast(true)?;
    socket.bind(&SocketAddrV4::new(address, PORT).into())?;
    socket.set_read_timeout(Some(LOOK))?;
    Ok(socket.into())
}

impl Camera {
    /// Opens the device.
    ///
    /// # Errors
    /// The address is not this machine's, or another device has it.
    pub fn start(info: CameraInfo, imager: Box<dyn Imager>, address: Ipv4Addr) -> Result<Self, GigeError> {
        let failed = |source: io::Error| match source.kind() {
            io::ErrorKind::AddrInUse => GigeError::InUse { address },
            _ => GigeError::Socket { address, source },
        };
        let own = UdpSocket::bind((address, PORT)).map_err(failed)?;
        own.set_read_timeout(Some(LOOK)).map_err(failed)?;
        let stream = UdpSocket::bind((address, 0)).map_err(failed)?;
        let stream_port = stream.local_addr().map_err(failed)?.port();
        let mut broadcasts = vec![broadcast_socket(Ipv4Addr::BROADCAST).map_err(failed)?];
        if address.is_loopback() {
            broadcasts.push(broadcast_socket(Ipv4Addr::new(127, 255, 255, 255)).map_err(failed)?);
        }
        let shared = Arc::new(Shared {
            control: Mutex::new(Control::new(&info, address, stream_port, Instant::now())),
            info,
            changed: Condvar::new(),
            stopping: AtomicBool::new(false),
            is_loopback: address.is_loopback(),
            stream,
            recent: Mutex::default(),
            statistics: Mutex::default(),
        });
        let mut threads = Vec::new();
        let own = Arc::new(own);
        for socket in broadcasts {
            let (shared, own) = (Arc::clone(&shared), Arc::clone(&own));
            threads.push(std::thread::spawn(move || shared.listen(&socket, &own, true)));
        }
        let listening = Arc::clone(&shared);
        threads.push(std::thread::spawn(move || listening.listen(&own, &own, false)));
        let taking = Arc::clone(&shared);
        threads.push(std::thread::spawn(move || acquisition::run(&taking, imager)));
        Ok(Self { shared, threads })
    }

    /// What it has done so far.
    pub fn statistics(&self) -> Statistics {
        self.shared.statistics().clone()
    }

    /// Who controls it.
    pub fn controller(&self) -> Option<SocketAddr> {
        self.shared.control().controller()
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        self.shared.stopping.store(true, Ordering::Relaxed);
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
