//! Effects of real actuators: each against a closed form that the test derives, and nothing changed while all are off.

mod identity;
