//! What travels between board and host: frames in any chunks, corruption, the version handshake, packed rows, sizes,
//! and what constants and texts are worth.

mod contents;
mod frames;
mod samples;
