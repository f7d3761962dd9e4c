//! The files of the page. Everything that it needs is here: nothing is loaded from elsewhere.

/// A file: its content and type.
pub(crate) struct File {
    pub(crate) kind: &'static str,
    pub(crate) body: &'static [u8],
}

/// The file under `path`.
pub(crate) fn file(path: &str) -> Option<File> {
    let script = "text/javascript; charset=utf-8";
    let (kind, body): (_, &[u8]) = match path {
        "/" => ("text/html; charset=utf-8", include_bytes!("../page/index.html")),
        "/console.css" => ("text/css; charset=utf-8", include_bytes!("../page/console.css")),
        "/console.js" => (script, include_bytes!("../page/console.js")),
        "/clock.js" => (script, include_bytes!("../page/clock.js")),
        "/pad.js" => (script, include_bytes!("../page/pad.js")),
        "/arm.js" => (script, include_bytes!("../page/arm.js")),
        "/state.js" => (script, include_bytes!("../page/state.js")),
        "/live.js" => (script, include_bytes!("../page/live.js")),
        "/hold.js" => (script, include_bytes!("../page/hold.js")),
        "/touch.js" => (script, include_bytes!("../page/touch.js")),
        "/said.js" => (script, include_bytes!("../page/said.js")),
        "/sheet.js" => (script, include_bytes!("../page/sheet.js")),
        "/three.js" => (script, include_bytes!("../page/three.bundle.js")),
        "/icon.svg" => ("image/svg+xml", include_bytes!("../page/icon.svg")),
        _ => return None,
    };
    Some(File { kind, body })
}

/// The page for those who came in the clear to a console under TLS at `origin`.
pub(crate) fn insecure(origin: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>foretrace</title><h1>This \
         address is not secure</h1><p>Open <a href=\"{origin}/\">{origin}/</a> instead, or the whole address \
         with the token that <code>foretrace console</code> printed.<p>Over plain HTTP browsers give a page \
         one pen sample per picture of the screen at most: the samples in between (getCoalescedEvents, \
         pointerrawupdate) and their rate would be lost, and everybody on the way could read the \
         token.</html>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_page_names_is_there_and_nothing_comes_from_elsewhere() {
        let index = String::from_utf8(file("/").unwrap().body.to_vec()).unwrap();
        let named = ["/console.css", "/console.js", "/icon.svg"];
        assert!(named.iter().all(|path| index.contains(&path[1..]) && file(path).is_some()));
        let scripts = ["console", "clock", "pad", "arm", "state", "live", "hold", "touch", "said", "sheet"];
        let scripts = scripts.map(|name| format!("/{name}.js"));
        for path in ["/", "/console.css"].into_iter().chain(scripts.iter().map(String::as_str)) {
            let text = String::from_utf8(file(path).unwrap().body.to_vec()).unwrap();
            // The name of a kind of document is no address.
            let text = text.replace("http://www.w3.org/2000/svg", "");
            for line in text.lines().filter(|line| line.contains("import ") && line.contains(" from ")) {
                let path = line.split('"').nth(1).unwrap_or_default().trim_start_matches('.');
                assert!(file(path).is_some(), "{line}");
            }
            assert!(!text.contains("https://") && !text.contains("http://"), "{path}");
        }
        assert!(file("/../Cargo.toml").is_none() && file("/none").is_none());
    }
}
