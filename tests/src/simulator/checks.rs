//! The simulator against mechanics, against itself, and against recordings of another program.

mod arm;
mod movement;
mod sample_data;
mod sampled;
