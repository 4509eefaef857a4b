//! The committed header is the one that the code gives.

use std::fs;
use std::path::Path;

/// `OMNIWALK_RENEW_HEADER=1 cargo test --release -p omniwalk-controller-c --test header` writes it.
#[test]
fn the_header_is_current() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_root_or_default(folder);
    let sources = ["src/types.rs", "src/abi.rs"].map(|file| folder.join(file));
    let builder = sources
        .iter()
        .fold(cbindgen::Builder::new().with_config(config), |builder, file| {
            builder.with_src(file)
        });
    let mut header = Vec::new();
    builder
        .generate()
        .expect("the sources make a header")
        .write(&mut header);
    let path = folder.join("include/omniwalk.h");
    if std::env::var_os("OMNIWALK_RENEW_HEADER").is_some() {
        fs::write(&path, &header).expect("writes the header");
    }
    let committed = fs::read_to_string(&path).unwrap_or_default();
    let header = String::from_utf8(header).expect("text");
    assert!(
        committed == header,
        "include/omniwalk.h is not what src gives; renew it as said above"
    );
}
