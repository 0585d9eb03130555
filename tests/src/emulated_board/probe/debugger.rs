//! The emulator's own debugger port, which speaks GDB's remote serial protocol: what a debug probe's wires are served by.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Longest run of bytes in one packet: its digits and their frame stay within the 4 KiB that the emulator takes.
const MOST_BYTES: usize = 1024;
/// How long to look for a stop that may not have come.
const GLANCE: Duration = Duration::from_micros(200);
/// What stops a running core.
const INTERRUPT: u8 = 3;
/// A stop that was asked for; every other one is the core's own doing.
const STOPPED_BY_INTERRUPT: &str = "02";

/// Why the emulator does not answer.
#[derive(Debug, thiserror::Error)]
pub enum DebuggerError {
    /// The connection.
    #[error("the emulator's debugger port is gone: {0}")]
    Gone(#[from] std::io::Error),
    /// The protocol.
    #[error("the emulator answered \"{answer}\" to \"{request}\"")]
    Unexpected {
        /// What was asked.
        request: String,
        /// What came.
        answer: String,
    },
}

/// A core of the emulator, held or running.
pub struct Debugger {
    stream: TcpStream,
    is_running: bool,
}

impl Debugger {
    /// Takes hold of the core, and lets it go on at once: a probe that is plugged in stops nothing.
    pub fn connect(address: SocketAddr) -> Result<Self, DebuggerError> {
        let stream = TcpStream::connect(address)?;
        stream.set_nodelay(true)?;
        let mut debugger = Self { stream, is_running: false };
        debugger.send("QStartNoAckMode")?;
        debugger.receive()?;
        // The other side may have read only part of this when it acknowledges.
        debugger.stream.write_all(b"+")?;
        debugger.resume()?;
        Ok(debugger)
    }

    /// Lets the core run.
    pub fn resume(&mut self) -> Result<(), DebuggerError> {
        self.send("c")?;
        self.is_running = true;
        Ok(())
    }

    /// One instruction, without interrupts.
    pub fn step(&mut self) -> Result<(), DebuggerError> {
        self.send("s")?;
        self.receive().map(drop)
    }

    /// Whether the core runs, or has stopped by itself.
    pub fn is_running(&mut self) -> Result<bool, DebuggerError> {
        if self.is_running {
            self.stream.set_read_timeout(Some(GLANCE))?;
            let glance = self.stream.peek(&mut [0]);
            self.stream.set_read_timeout(None)?;
            match glance {
                Ok(_) => {
                    self.receive()?;
                    self.is_running = false;
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(self.is_running)
    }

    /// Stops the core where it is.
    pub fn halt(&mut self) -> Result<(), DebuggerError> {
        self.stop().map(drop)
    }

    /// Resets the microcontroller and holds the core before its first instruction.
    pub fn reset(&mut self) -> Result<(), DebuggerError> {
        self.halt()?;
        let command: String = "reset".bytes().map(|byte| format!("{byte:02x}")).collect();
        self.ask(&format!("qRcmd,{command}")).map(drop)
    }

    /// A register of the core, by GDB's number.
    pub fn register(&mut self, number: usize) -> Result<u32, DebuggerError> {
        let request = format!("p{number:x}");
        let answer = self.ask(&request)?;
        let bytes = from_digits(&answer).and_then(|bytes| <[u8; 4]>::try_from(bytes).ok());
        bytes.map(u32::from_le_bytes).ok_or(DebuggerError::Unexpected { request, answer })
    }

    /// Sets it.
    pub fn set_register(&mut self, number: usize, value: u32) -> Result<(), DebuggerError> {
        let request = format!("P{number:x}={:08x}", value.swap_bytes());
        let answer = self.ask(&request)?;
        if answer == "OK" { Ok(()) } else { Err(DebuggerError::Unexpected { request, answer }) }
    }

    /// Fills `bytes` from memory or registers; false where nothing answers. The core stands still meanwhile.
    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<bool, DebuggerError> {
        self.while_held(|debugger| {
            for (index, part) in bytes.chunks_mut(MOST_BYTES).enumerate() {
                let from = u64::from(address) + (index * MOST_BYTES) as u64;
                let answer = debugger.ask(&format!("m{from:x},{:x}", part.len()))?;
                match from_digits(&answer) {
                    Some(read) if read.len() == part.len() => part.copy_from_slice(&read),
                    _ => return Ok(false),
                }
            }
            Ok(true)
        })
    }

    /// Writes `bytes`; false where nothing takes them. The core stands still meanwhile.
    pub fn write(&mut self, address: u32, bytes: &[u8]) -> Result<bool, DebuggerError> {
        self.while_held(|debugger| {
            for (index, part) in bytes.chunks(MOST_BYTES).enumerate() {
                let to = u64::from(address) + (index * MOST_BYTES) as u64;
                let digits: String = part.iter().map(|byte| format!("{byte:02x}")).collect();
                if debugger.ask(&format!("M{to:x},{:x}:{digits}", part.len()))? != "OK" {
                    return Ok(false);
                }
            }
            Ok(true)
        })
    }

    /// Lets the core go on without a debugger.
    pub fn detach(mut self) -> Result<(), DebuggerError> {
        self.halt()?;
        self.ask("D").map(drop)
    }

    fn while_held<T>(&mut self, act: impl FnOnce(&mut Self) -> Result<T, DebuggerError>) -> Result<T, DebuggerError> {
        let goes_on = self.stop()?;
        let done = act(self)?;
        if goes_on {
            self.resume()?;
        }
        Ok(done)
    }

    /// Stops the core; says whether it ran until it was told.
    fn stop(&mut self) -> Result<bool, DebuggerError> {
        if !self.is_running()? {
            return Ok(false);
        }
        self.stream.write_all(&[INTERRUPT])?;
        self.is_running = false;
        let was_told = self.receive()?.get(1..3) == Some(STOPPED_BY_INTERRUPT);
        if !was_told {
            // It had stopped by itself before it heard, and would take the interrupt for the next time it is to run.
            self.send("c")?;
            self.receive()?;
        }
        Ok(was_told)
    }

    fn ask(&mut self, request: &str) -> Result<String, DebuggerError> {
        self.send(request)?;
        self.receive()
    }

    fn send(&mut self, contents: &str) -> Result<(), DebuggerError> {
        let sum = contents.bytes().fold(0_u8, u8::wrapping_add);
        Ok(self.stream.write_all(format!("${contents}#{sum:02x}").as_bytes())?)
    }

    /// The next packet, whatever stands before it.
    fn receive(&mut self) -> Result<String, DebuggerError> {
        let mut byte = [0];
        while byte != *b"$" {
            self.stream.read_exact(&mut byte)?;
        }
        let mut contents = String::new();
        loop {
            self.stream.read_exact(&mut byte)?;
            if byte == *b"#" {
                // A connection within one computer damages nothing.
                self.stream.read_exact(&mut [0; 2])?;
                return Ok(contents);
            }
            contents.push(char::from(byte[0]));
        }
    }
}

/// Bytes from two hexadecimal digits each.
pub fn from_digits(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    pairs.map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok().filter(|_| pair.len() == 2)).collect()
}
