//! Prints the DBC file: `cargo run -p ema-wire --example make_dbc > fixtures/ema.dbc`.

mod dbc;

fn main() {
    print!("{}", dbc::dbc());
}
