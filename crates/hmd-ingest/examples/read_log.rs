//! Reads logs of any format: frames, losses and time of each, for `cargo xtask readers`.

use std::path::Path;
use std::time::Instant;

use hmd_ingest::file::open;

fn main() {
    for path in std::env::args().skip(1) {
        let start = Instant::now();
        let source = match open(Path::new(&path)) {
            Ok(source) => source,
            Err(error) => {
                eprintln!("{error}");
                std::process::exit(1);
            }
        };
        let (mut frames, mut losses) = (0_u64, 0_u64);
        for item in source {
            *(if item.is_ok() { &mut frames } else { &mut losses }) += 1;
        }
        println!("{path} {frames} {losses} {:.6}", start.elapsed().as_secs_f64());
    }
}
