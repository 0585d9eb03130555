//! A debug probe wired to the board's SWD pins, as programs on a computer see it: a Black Magic Probe on a TCP port. They
//! can halt the chip, reset it, and run code of theirs on it, such as that which erases and programs flash memory.
//!
//! | module | its one job |
//! |---|---|
//! | `black_magic` | the probe's protocol |
//! | `wires` | what goes over the two wires, bit by bit, as long as the probe knows no better |
//! | `debug_port` | the chip's side of the wires, and the core's debug registers |
//! | `debugger` | the emulator, which holds the core and lets it go |

mod black_magic;
mod debug_port;
mod debugger;
mod wires;

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use black_magic::BlackMagic;
use debug_port::DebugPort;
use debugger::{Debugger, DebuggerError};

/// How long to wait between two looks for a program that wants the probe.
const LOOK_AROUND: Duration = Duration::from_millis(5);

/// What the probe is on USB, as programs name it.
const USB_IDENTITY: &str = "1d50:6018";

/// The probe, in a thread of its own; gone when this is dropped.
pub struct DebugProbe {
    address: SocketAddr,
    in_use: Arc<AtomicBool>,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl DebugProbe {
    /// Serves one program at a time on a port of this computer, 0 for any, and has the chip from the emulator's debugger
    /// port at `debugger`.
    pub fn start(port: u16, debugger: SocketAddr) -> std::io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let [in_use, ends] = [false; 2].map(|value| Arc::new(AtomicBool::new(value)));
        let thread = std::thread::spawn({
            let (in_use, ends) = (in_use.clone(), ends.clone());
            move || {
                while !ends.load(Ordering::SeqCst) {
                    let Ok((stream, _)) = listener.accept() else {
                        std::thread::sleep(LOOK_AROUND);
                        continue;
                    };
                    in_use.store(true, Ordering::SeqCst);
                    if let Err(error) = serve(stream, debugger, &ends) {
                        eprintln!("debug probe: {error}");
                    }
                    in_use.store(false, Ordering::SeqCst);
                }
            }
        });
        Ok(Self { address, in_use, ends, thread: Some(thread) })
    }

    /// How programs name it.
    pub fn selector(&self) -> String {
        format!("{USB_IDENTITY}:{}", self.address)
    }

    /// Whether a program is using it: the chip's time has to go on then.
    pub fn is_in_use(&self) -> bool {
        self.in_use.load(Ordering::SeqCst)
    }
}

impl Drop for DebugProbe {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            // What went wrong in it has been told.
            let _ = thread.join();
        }
    }
}

/// Until the program has gone or nobody wants the probe any more.
fn serve(mut stream: TcpStream, debugger: SocketAddr, ends: &AtomicBool) -> Result<(), DebuggerError> {
    stream.set_nodelay(true)?;
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(LOOK_AROUND))?;
    let mut probe = BlackMagic::new(DebugPort::new(Debugger::connect(debugger)?));
    let mut request: Option<String> = None;
    let mut bytes = [0; 4096];
    while !ends.load(Ordering::SeqCst) {
        let count = match stream.read(&mut bytes) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => continue,
            // A program that was killed.
            Err(_) => break,
        };
        for &byte in &bytes[..count] {
            match byte {
                b'!' => request = Some(String::new()),
                b'#' => {
                    if let Some(request) = request.take() {
                        let answer = probe.answer(&request)?;
                        if stream.write_all(answer.to_line().as_bytes()).is_err() {
                            return probe.disconnect();
                        }
                    }
                }
                _ => request.iter_mut().for_each(|request| request.push(byte.into())),
            }
        }
    }
    probe.disconnect()
}
