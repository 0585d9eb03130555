//! A board behind a TCP socket: the emulated board, or a serial server.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use super::{Link, LinkError};

/// How long to try to connect to each address a name stands for.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);

/// A TCP connection to a board.
#[derive(Debug)]
pub struct TcpLink {
    stream: TcpStream,
    address: String,
    start: Instant,
}

impl TcpLink {
    /// Connects to `address`, `HOST:PORT`.
    pub fn connect(address: &str) -> Result<Self, LinkError> {
        let failed = |reason: std::io::Error| LinkError::Connect {
            address: format!("tcp:{address}"),
            reason: reason.to_string(),
            remedy: "check that the board or emulator is running and the port is right",
        };
        let mut last_error = std::io::Error::new(ErrorKind::NotFound, "the name stands for no address");
        for socket in address.to_socket_addrs().map_err(failed)? {
            match TcpStream::connect_timeout(&socket, CONNECT_TIMEOUT) {
                Ok(stream) => {
                    // Requests are small and answered one by one: waiting to fill packets would only add delay.
                    stream.set_nodelay(true).map_err(failed)?;
                    return Ok(Self { stream, address: address.into(), start: Instant::now() });
                }
                Err(error) => last_error = error,
            }
        }
        Err(failed(last_error))
    }

    fn broken(&self, reason: impl ToString) -> LinkError {
        LinkError::Broken { address: self.name(), reason: reason.to_string() }
    }
}

impl Link for TcpLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.stream.write_all(bytes).map_err(|error| self.broken(error))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        // A timeout of zero would mean none at all.
        let timeout = timeout.max(Duration::from_millis(1));
        self.stream.set_read_timeout(Some(timeout)).map_err(|error| self.broken(error))?;
        match self.stream.read(buffer) {
            Ok(0) => Err(self.broken("the other end closed it")),
            Ok(count) => Ok(count),
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) =>
            {
                Ok(0)
            }
            Err(error) => Err(self.broken(error)),
        }
    }

    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn name(&self) -> String {
        format!("tcp:{}", self.address)
    }
}
