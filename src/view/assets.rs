//! The page: its files, embedded.

/// A file of the page.
pub struct Asset {
    /// What a request calls it, without the leading slash; empty for the page itself.
    pub name: &'static str,
    /// Its media type.
    pub kind: &'static str,
    /// Its content.
    pub bytes: &'static [u8],
    /// Whether the content is compressed with gzip.
    pub compressed: bool,
}

const HTML: &str = "text/html; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! asset {
    ($name:literal, $kind:expr, $file:literal) => {
        Asset {
            name: $name,
            kind: $kind,
            bytes: include_bytes!(concat!("web/", $file)),
            compressed: false,
        }
    };
}

/// Every file there is.
pub const ASSETS: [Asset; 9] = [
    asset!("", HTML, "index.html"),
    asset!("style.css", STYLE, "style.css"),
    asset!("main.js", SCRIPT, "main.js"),
    asset!("scene.js", SCRIPT, "scene.js"),
    asset!("robot.js", SCRIPT, "robot.js"),
    asset!("plots.js", SCRIPT, "plots.js"),
    asset!("player.js", SCRIPT, "player.js"),
    asset!("driver.js", SCRIPT, "driver.js"),
    Asset {
        name: "three.js",
        kind: SCRIPT,
        bytes: include_bytes!("web/vendor/three.min.js.gz"),
        compressed: true,
    },
];

/// The file that a request calls `name`.
pub fn find(name: &str) -> Option<&'static Asset> {
    ASSETS.iter().find(|asset| asset.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_names_only_files_there_are_and_nothing_elsewhere() {
        for asset in ASSETS.iter().filter(|asset| !asset.compressed) {
            let text = std::str::from_utf8(asset.bytes).unwrap();
            for address in ["http:", "https:", "//cdn"] {
                assert!(!text.contains(address), "{} names {address}", asset.name);
            }
            let imports = text.split("from './").skip(1).chain(text.split("src=\"").skip(1));
            for rest in imports.chain(text.split("href=\"").skip(1)) {
                let name = rest.split(['\'', '"']).next().unwrap();
                assert!(
                    name.starts_with("data:") || find(name).is_some(),
                    "{} names {name}",
                    asset.name
                );
            }
        }
    }
}
