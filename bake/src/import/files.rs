//! Files beside the character's file, and data that is written into it as text.

use std::io::Read;
use std::path::{Component, Path, PathBuf};

use crate::error::ImportError;

/// Greatest file that is read into memory.
const MAX_FILE_BYTES: u64 = 4 << 30;

/// The whole content of the regular file at `path`.
///
/// Errors: [`ImportError::Io`], also for what is not a regular file (a device would never end) and for files above 4 GiB.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, ImportError> {
    let io = |source| ImportError::Io {
        path: path.to_path_buf(),
        source,
    };
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        return Err(io(std::io::Error::other("it is not a regular file")));
    }
    if metadata.len() > MAX_FILE_BYTES {
        return Err(io(std::io::Error::other("it is larger than 4 GiB")));
    }
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    let file = std::fs::File::open(path).map_err(io)?;
    file.take(MAX_FILE_BYTES)
        .read_to_end(&mut bytes)
        .map_err(io)?;
    Ok(bytes)
}

/// Where the relative reference `uri` of the file `path` leads: a file in the same folder or below it.
///
/// Errors: a reason, where the reference is absolute, has a scheme such as `http:` or leaves the folder.
pub(super) fn resolve(path: &Path, uri: &str) -> Result<PathBuf, String> {
    let scheme = uri.split(['/', '?', '#']).next().unwrap_or_default();
    if scheme.contains(':') {
        return Err(format!(
            "'{}' is not a file beside this one",
            shorten(uri, 80)
        ));
    }
    let relative = percent_decode(uri).ok_or("its uri has a broken %-escape")?;
    if relative.contains('\0') {
        return Err("its uri contains a zero byte".into());
    }
    let relative = PathBuf::from(relative.replace('\\', "/"));
    let inside = relative
        .components()
        .all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if !inside || relative.as_os_str().is_empty() {
        return Err(format!(
            "'{}' does not stay in the folder of this file",
            shorten(uri, 80)
        ));
    }
    Ok(path.parent().unwrap_or(Path::new("")).join(relative))
}

/// The bytes of a `data:` URI; `None` where `uri` is not one. Errors: a reason.
pub(super) fn data_uri(uri: &str) -> Option<Result<Vec<u8>, String>> {
    let rest = uri.strip_prefix("data:")?;
    Some(match rest.split_once(',') {
        None => Err("its data URI has no comma".into()),
        Some((kind, data)) if kind.ends_with(";base64") => {
            base64(data.as_bytes()).ok_or_else(|| "its base64 data is broken".into())
        }
        Some((_, data)) => percent_decode_bytes(data)
            .ok_or_else(|| "its data URI has a broken %-escape".to_string()),
    })
}

/// Decodes base64 of either alphabet (RFC 4648), with or without padding.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let padding = text.iter().rev().take_while(|&&b| b == b'=').count();
    let text = &text[..text.len() - padding];
    if padding > 2 || text.len() % 4 == 1 {
        return None;
    }
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    let (mut bits, mut bit_count) = (0u32, 0);
    for &b in text {
        let value = match b {
            b'A'..=b'Z' => b - b'A',
            b'a'..=b'z' => b - b'a' + 26,
            b'0'..=b'9' => b - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        bit_count += 6;
        if bit_count >= 8 {
            bit_count -= 8;
            bytes.push((bits >> bit_count) as u8);
        }
    }
    Some(bytes)
}

fn percent_decode(text: &str) -> Option<String> {
    String::from_utf8(percent_decode_bytes(text)?).ok()
}

fn percent_decode_bytes(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(b) = rest.next() {
        bytes.push(if b == b'%' {
            let digit = |b: u8| (b as char).to_digit(16);
            (digit(rest.next()?)? * 16 + digit(rest.next()?)?) as u8
        } else {
            b
        });
    }
    Some(bytes)
}

/// The first `most` characters of `text`: names in messages stay short whatever the file says.
pub(super) fn shorten(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_decodes_every_remainder_and_refuses_rubbish() {
        assert_eq!(base64(b"").unwrap(), b"");
        assert_eq!(base64(b"TQ==").unwrap(), b"M");
        assert_eq!(base64(b"TWE=").unwrap(), b"Ma");
        assert_eq!(base64(b"TWFu").unwrap(), b"Man");
        assert_eq!(base64(b"_-8").unwrap(), [0xff, 0xef]);
        assert_eq!(base64(b"T"), None);
        assert_eq!(base64(b"T!=="), None);
    }

    #[test]
    fn references_stay_in_the_folder() {
        let path = Path::new("dir/a.gltf");
        assert_eq!(resolve(path, "b%20c.bin"), Ok("dir/b c.bin".into()));
        assert_eq!(resolve(path, "./t\\b.png"), Ok("dir/./t/b.png".into()));
        for uri in [
            "../b.bin",
            "/etc/passwd",
            "%2e%2e/b",
            "http://x/y",
            "C:\\b",
            "",
            "a%2",
            "a%00",
        ] {
            assert!(resolve(path, uri).is_err(), "{uri}");
        }
    }
}
