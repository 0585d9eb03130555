//! Frames: header byte, postcard, CRC-32, COBS, closing 0; and the streaming decoder.

use super::{BoardMessage, HANDSHAKE_HEADER, HostMessage, MAX_CONTENT, MAX_FRAME, PROTOCOL_VERSION, Reply, Request};
use cobs::{DecodeResult, DecoderState};
use crc::{CRC_32_ISO_HDLC, Crc, Digest, Table};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The CRC-32 of Ethernet and zip, with a table of 1 KiB.
static CRC_32: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// Bytes of the CRC at the end of a frame's content.
const CRC_BYTES: usize = 4;

/// A CRC-32 of bytes given one after the other.
pub(crate) struct Checksum(Digest<'static, u32, Table<1>>);

impl Checksum {
    pub(crate) fn new() -> Self {
        Self(CRC_32.digest())
    }

    #[inline(never)]
    pub(crate) fn add(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    pub(crate) fn finish(self) -> u32 {
        self.0.finalize()
    }
}

/// The CRC-32 of pieces one after the other.
pub(crate) fn crc_32(pieces: &[&[u8]]) -> u32 {
    let mut checksum = Checksum::new();
    for piece in pieces {
        checksum.add(piece);
    }
    checksum.finish()
}

/// Why a message could not be put into a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The message is longer than a frame.
    #[error("the message does not fit a frame of {max} bytes; send it in parts")]
    TooLong {
        /// [`super::MAX_FRAME`].
        max: usize,
    },
    /// The buffer given is too small for the frame.
    #[error("the frame of {len} bytes does not fit the buffer of {max} bytes; give {} bytes", super::MAX_FRAME)]
    Buffer {
        /// Bytes of the frame.
        len: usize,
        /// Bytes of the buffer.
        max: usize,
    },
}

/// Puts a host's message into a frame in `buffer`; [`super::MAX_FRAME`] bytes are always enough. Returns the frame.
#[inline]
pub fn encode_host_message<'a>(message: &HostMessage, buffer: &'a mut [u8]) -> Result<&'a [u8], EncodeError> {
    let handshake = matches!(message.request, Request::Hello { .. });
    encode(message, handshake, buffer)
}

/// Puts a board's message into a frame in `buffer`; [`super::MAX_FRAME`] bytes are always enough. Returns the frame.
#[inline]
pub fn encode_board_message<'a>(message: &BoardMessage, buffer: &'a mut [u8]) -> Result<&'a [u8], EncodeError> {
    let handshake = matches!(message, BoardMessage::Reply { reply: Reply::WrongVersion { .. }, .. });
    encode(message, handshake, buffer)
}

fn encode<'a>(message: &impl Serialize, handshake: bool, buffer: &'a mut [u8]) -> Result<&'a [u8], EncodeError> {
    let too_long = EncodeError::TooLong { max: MAX_FRAME };
    let mut content = [0; MAX_CONTENT];
    let header = if handshake { HANDSHAKE_HEADER } else { PROTOCOL_VERSION };
    let (body, _) = content.split_at_mut(MAX_CONTENT - CRC_BYTES);
    let (first, rest) = body.split_first_mut().ok_or(too_long)?;
    *first = header;
    // Postcard's only error here is a message that does not fit.
    let len = 1 + postcard::to_slice(message, rest).map_err(|_| too_long)?.len();
    let mut checksum = Checksum::new();
    checksum.add(content.get(..len).ok_or(too_long)?);
    let crc = checksum.finish().to_le_bytes();
    content.get_mut(len..len + CRC_BYTES).ok_or(too_long)?.copy_from_slice(&crc);
    let content = content.get(..len + CRC_BYTES).ok_or(too_long)?;

    let max = buffer.len();
    let does_not_fit = EncodeError::Buffer { len: cobs::max_encoding_length(content.len()) + 1, max };
    let encoded = cobs::try_encode(content, buffer).map_err(|_| does_not_fit)?;
    *buffer.get_mut(encoded).ok_or(does_not_fit)? = 0;
    buffer.get(..=encoded).ok_or(does_not_fit)
}

/// Why a frame was thrown away.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// More bytes between two zeros than a frame has.
    #[error("a frame of {len} bytes or more, at most {max} are allowed")]
    FrameTooLong {
        /// Content bytes received when the decoder gave up, at least.
        len: usize,
        /// Most content bytes a frame may have here.
        max: usize,
    },
    /// Fewer bytes than a header and a CRC.
    #[error("a frame of {len} bytes, at least {min} are needed")]
    TooShort {
        /// Content bytes received.
        len: usize,
        /// Fewest content bytes of any frame.
        min: usize,
    },
    /// The zero came too early for the COBS code: the frame was cut.
    #[error("a frame was cut after {len} bytes")]
    Cobs {
        /// Content bytes received before the cut.
        len: usize,
    },
    /// The content is not what was sent.
    #[error("CRC {received:08x} in the frame, {computed:08x} of its content")]
    Crc {
        /// CRC in the frame.
        received: u32,
        /// CRC of the content received.
        computed: u32,
    },
    /// An intact frame of another protocol version.
    #[error("protocol version {theirs}, here {ours}; update the older of host tool and firmware")]
    Version {
        /// Header of the frame.
        theirs: u8,
        /// [`PROTOCOL_VERSION`].
        ours: u8,
    },
    /// An intact frame that is not a message: both ends claim the same version and differ.
    #[error("an intact frame of {len} bytes is no message of protocol version {PROTOCOL_VERSION}")]
    Message {
        /// Content bytes.
        len: usize,
    },
}

/// How many frames came, and how many were thrown away for what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Good frames.
    pub received: u32,
    /// [`FrameError::FrameTooLong`].
    pub too_long: u32,
    /// [`FrameError::TooShort`].
    pub too_short: u32,
    /// [`FrameError::Cobs`].
    pub cobs: u32,
    /// [`FrameError::Crc`].
    pub crc: u32,
    /// [`FrameError::Version`].
    pub version: u32,
    /// [`FrameError::Message`].
    pub message: u32,
}

impl FrameCounters {
    /// Frames thrown away, of every kind.
    pub fn bad(&self) -> u32 {
        [self.too_long, self.too_short, self.cobs, self.crc, self.version, self.message]
            .into_iter()
            .fold(0, u32::saturating_add)
    }
}

/// Takes bytes in pieces of any size and gives messages. After anything unusable it finds its way back at the next
/// zero byte. `N` is the most content bytes it accepts, [`MAX_CONTENT`] at both ends of this protocol.
///
/// ```
/// use shared::protocol::{Decoder, HostMessage, MAX_FRAME, Request, encode_host_message};
/// let message = HostMessage { sequence: 7, request: Request::Arm };
/// let mut buffer = [0; MAX_FRAME];
/// let frame = encode_host_message(&message, &mut buffer).unwrap();
/// let mut decoder: Decoder = Decoder::new();
/// let got = frame.iter().find_map(|&byte| decoder.host_message(byte)).unwrap();
/// assert_eq!(got, Ok(message));
/// ```
#[derive(Debug)]
pub struct Decoder<const N: usize = MAX_CONTENT> {
    state: DecoderState,
    content: [u8; N],
    /// Content bytes of the frame so far; those beyond `N` are counted and dropped.
    len: usize,
    counters: FrameCounters,
}

impl<const N: usize> Default for Decoder<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Decoder<N> {
    /// A decoder waiting for the first byte of a frame.
    pub const fn new() -> Self {
        let counters =
            FrameCounters { received: 0, too_long: 0, too_short: 0, cobs: 0, crc: 0, version: 0, message: 0 };
        Self { state: DecoderState::Idle, content: [0; N], len: 0, counters }
    }

    /// Takes the next byte at the board's end. Some at the end of a frame: the message, or why there is none.
    #[inline]
    pub fn host_message(&mut self, byte: u8) -> Option<Result<HostMessage, FrameError>> {
        self.message(byte, |message: &HostMessage| matches!(message.request, Request::Hello { .. }))
    }

    /// Takes the next byte at the host's end. Some at the end of a frame: the message, or why there is none.
    #[inline]
    pub fn board_message(&mut self, byte: u8) -> Option<Result<BoardMessage, FrameError>> {
        self.message(byte, |message: &BoardMessage| {
            matches!(message, BoardMessage::Reply { reply: Reply::WrongVersion { .. }, .. })
        })
    }

    /// What was received and thrown away since the start.
    pub fn counters(&self) -> FrameCounters {
        self.counters
    }

    fn message<M: DeserializeOwned>(
        &mut self,
        byte: u8,
        is_handshake: impl Fn(&M) -> bool,
    ) -> Option<Result<M, FrameError>> {
        let complete = self.unstuff(byte)?;
        let message = complete.and_then(|()| self.open(is_handshake));
        self.len = 0;
        let counter = match message {
            Ok(_) => &mut self.counters.received,
            Err(FrameError::FrameTooLong { .. }) => &mut self.counters.too_long,
            Err(FrameError::TooShort { .. }) => &mut self.counters.too_short,
            Err(FrameError::Cobs { .. }) => &mut self.counters.cobs,
            Err(FrameError::Crc { .. }) => &mut self.counters.crc,
            Err(FrameError::Version { .. }) => &mut self.counters.version,
            Err(FrameError::Message { .. }) => &mut self.counters.message,
        };
        *counter = counter.saturating_add(1);
        Some(message)
    }

    /// Takes one byte; Some at a zero that ends a frame.
    fn unstuff(&mut self, byte: u8) -> Option<Result<(), FrameError>> {
        let len = self.len;
        match self.state.feed(byte) {
            Ok(DecodeResult::NoData) => None,
            Ok(DecodeResult::DataStart) => {
                self.len = 0;
                None
            }
            Ok(DecodeResult::DataContinue(data)) => {
                if let Some(place) = self.content.get_mut(len) {
                    *place = data;
                }
                self.len = len.saturating_add(1);
                None
            }
            // A frame too long is told from a cut one only by its length: both may end anywhere in the code.
            _ if len > N => Some(Err(FrameError::FrameTooLong { len, max: N })),
            Ok(DecodeResult::DataComplete) => Some(Ok(())),
            Err(_) => Some(Err(FrameError::Cobs { len })),
        }
    }

    /// The message in the content received.
    fn open<M: DeserializeOwned>(&self, is_handshake: impl Fn(&M) -> bool) -> Result<M, FrameError> {
        let len = self.len;
        let too_short = FrameError::TooShort { len, min: 1 + CRC_BYTES };
        let content = self.content.get(..len).ok_or(FrameError::FrameTooLong { len, max: N })?;
        let (sealed, crc) = content.split_last_chunk::<CRC_BYTES>().ok_or(too_short)?;
        let (&header, body) = sealed.split_first().ok_or(too_short)?;
        let mut checksum = Checksum::new();
        checksum.add(sealed);
        let (received, computed) = (u32::from_le_bytes(*crc), checksum.finish());
        if received != computed {
            return Err(FrameError::Crc { received, computed });
        }
        let no_message = FrameError::Message { len };
        match header {
            HANDSHAKE_HEADER => {
                // Later versions may add fields to the handshake: what follows the known ones is skipped.
                let (message, _) = postcard::take_from_bytes::<M>(body).map_err(|_| no_message)?;
                if is_handshake(&message) { Ok(message) } else { Err(no_message) }
            }
            PROTOCOL_VERSION => {
                let (message, rest) = postcard::take_from_bytes::<M>(body).map_err(|_| no_message)?;
                if rest.is_empty() && !is_handshake(&message) { Ok(message) } else { Err(no_message) }
            }
            theirs => Err(FrameError::Version { theirs, ours: PROTOCOL_VERSION }),
        }
    }
}
