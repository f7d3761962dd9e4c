//! This machine's own certificate, for pages on other machines.
//!
//! Contract: made here, kept in a file that its user alone may read, and never anywhere else. What is kept is
//! used only while it names the same addresses, lasts and fits its key; else another one is made. It signs
//! itself: nobody else vouches for it, which is why people compare its fingerprint.

use std::fs::{self, DirBuilder, OpenOptions, Permissions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rcgen::{
    CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, KeyPair, KeyUsagePurpose,
};
use rustls::ServerConfig;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer};

const DAY: Duration = Duration::from_secs(86_400);
/// Browsers take no longer ones from 398 days on.
const LASTS_DAYS: u32 = 397;
/// Another one is made this long before the end.
const RENEWED_DAYS: u32 = 30;
/// A clock of another machine may be behind.
const EARLIER: Duration = DAY;
/// Largest file that is read \[bytes\].
const FILE_BYTES: u64 = 64 * 1024;
/// Its first line; the number is the version of the layout.
const FIRST_LINE: &str = "foretrace console certificate 1";

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
pub enum CertificateError {
    /// The file cannot be kept.
    #[error("the certificate cannot be kept in {}: {source}: make its folder writable, or name another with \
             XDG_STATE_HOME", path.display())]
    File { path: PathBuf, source: io::Error },
    /// It cannot be made for these names.
    #[error("no certificate can be made for {names}: {reason}: name another address with --lan=ADDRESS")]
    Made { names: String, reason: String },
}

/// A certificate with its key, ready for TLS.
#[derive(Clone)]
pub struct Certificate {
    pub(crate) config: Arc<ServerConfig>,
    fingerprint: String,
    until_s: u64,
    made: Option<&'static str>,
}

impl std::fmt::Debug for Certificate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Certificate").field("fingerprint", &self.fingerprint).finish_non_exhaustive()
    }
}

/// What the file holds.
struct Kept {
    names: Vec<String>,
    until_s: u64,
    certificate: Vec<u8>,
    key: Vec<u8>,
}

impl Certificate {
    /// The certificate for `names` (addresses and host names) that is kept in `file`; where that one does not
    /// fit or ends soon after `now`, another is made and kept.
    ///
    /// # Errors
    ///
    /// `File`, `Made`.
    pub fn kept(file: &Path, names: &[String], now: SystemTime) -> Result<Self, CertificateError> {
        let failed = |source| CertificateError::File { path: file.to_owned(), source };
        let now_s = now.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let why = match read(file).map_err(failed)? {
            Err(why) => why,
            Ok(kept) if kept.names != names => "the addresses of this machine have changed",
            Ok(kept) if kept.until_s < now_s + u64::from(RENEWED_DAYS) * DAY.as_secs() => {
                "the one before ends, or has ended"
            }
            Ok(kept) => match Self::of(&kept, None) {
                Ok(certificate) => return Ok(certificate),
                Err(_) => "the one before does not fit its key",
            },
        };
        let unmade = |reason: String| CertificateError::Made { names: names.join(", "), reason };
        let kept = make(names, now_s).map_err(|error| unmade(error.to_string()))?;
        let certificate = Self::of(&kept, Some(why)).map_err(|error| unmade(error.to_string()))?;
        write(file, &kept).map_err(failed)?;
        Ok(certificate)
    }

    fn of(kept: &Kept, made: Option<&'static str>) -> Result<Self, rustls::Error> {
        let chain = vec![CertificateDer::from(kept.certificate.clone())];
        let key = PrivateKeyDer::from(PrivatePkcs8KeyDer::from(kept.key.clone()));
        let mut config =
            ServerConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
                .with_safe_default_protocol_versions()?
                .with_no_client_auth()
                .with_single_cert(chain, key)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        let digest = rustls::crypto::ring::cipher_suite::TLS13_AES_128_GCM_SHA256
            .tls13()
            .map(|suite| suite.common.hash_provider.hash(&kept.certificate));
        let bytes = digest.as_ref().map_or(&[][..], AsRef::as_ref);
        let pairs: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
        Ok(Self { config: Arc::new(config), fingerprint: pairs.join(":"), until_s: kept.until_s, made })
    }

    /// SHA-256 of the certificate as browsers show it: pairs of hexadecimal digits with colons.
    #[must_use]
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    /// Whole days from `now` until it ends.
    #[must_use]
    pub fn days_left(&self, now: SystemTime) -> u64 {
        let now_s = now.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        self.until_s.saturating_sub(now_s) / DAY.as_secs()
    }

    /// Why it was made just now; `None`: it is the one that was kept.
    #[must_use]
    pub const fn made(&self) -> Option<&'static str> {
        self.made
    }
}

fn make(names: &[String], now_s: u64) -> Result<Kept, rcgen::Error> {
    let key = KeyPair::generate()?;
    let mut params = CertificateParams::new(names)?;
    let begin = UNIX_EPOCH + Duration::from_secs(now_s) - EARLIER;
    let until_s = now_s + u64::from(LASTS_DAYS) * DAY.as_secs() - 2 * DAY.as_secs();
    (params.not_before, params.not_after) =
        (begin.into(), (UNIX_EPOCH + Duration::from_secs(until_s)).into());
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, "foretrace console");
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
    let certificate = params.self_signed(&key)?;
    Ok(Kept {
        names: names.to_vec(),
        until_s,
        certificate: certificate.der().to_vec(),
        key: key.serialize_der(),
    })
}

/// What is kept, or why it is of no use.
fn read(file: &Path) -> io::Result<Result<Kept, &'static str>> {
    let opened = match fs::File::open(file) {
        Ok(opened) => opened,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Err("there was none")),
        Err(error) => return Err(error),
    };
    if opened.metadata()?.permissions().mode() & 0o077 != 0 {
        return Ok(Err("others could read the key of the one before"));
    }
    let mut text = String::new();
    if opened.take(FILE_BYTES).read_to_string(&mut text).is_err() {
        return Ok(Err("the file of the one before is damaged"));
    }
    Ok(parse(&text).ok_or("the file of the one before is damaged"))
}

fn parse(text: &str) -> Option<Kept> {
    let mut lines = text.lines();
    if lines.next()? != FIRST_LINE {
        return None;
    }
    let mut value = |key: &str| lines.next()?.strip_prefix(key)?.strip_prefix(' ');
    let names = value("names")?.split(' ').map(str::to_owned).collect();
    let until_s = value("until")?.parse().ok()?;
    let (certificate, key) = (bytes(value("certificate")?)?, bytes(value("key")?)?);
    Some(Kept { names, until_s, certificate, key })
}

fn bytes(hex: &str) -> Option<Vec<u8>> {
    data_encoding::HEXLOWER.decode(hex.as_bytes()).ok()
}

/// Keeps it whole or not at all.
fn write(file: &Path, kept: &Kept) -> io::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
    let hex = |bytes: &[u8]| data_encoding::HEXLOWER.encode(bytes);
    let text = format!(
        "{FIRST_LINE}\nnames {}\nuntil {}\ncertificate {}\nkey {}\n",
        kept.names.join(" "),
        kept.until_s,
        hex(&kept.certificate),
        hex(&kept.key)
    );
    let part = file.with_extension(format!("part-{}", std::process::id()));
    let written = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .mode(0o600)
        .open(&part)
        .and_then(|mut out| {
            out.set_permissions(Permissions::from_mode(0o600))?;
            out.write_all(text.as_bytes())?;
            out.sync_all()
        })
        .and_then(|()| fs::rename(&part, file));
    if written.is_err() {
        // It may not be there.
        let _ = fs::remove_file(&part);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Vec<String> {
        text.split(' ').map(str::to_owned).collect()
    }

    #[test]
    fn it_is_kept_for_its_user_alone_and_used_again_until_it_ends_or_the_addresses_change() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state/foretrace/console-certificate");
        let now = SystemTime::now();
        let here = names("192.168.7.2 fd00::2 127.0.0.1 desk localhost");
        let first = Certificate::kept(&file, &here, now).unwrap();
        assert_eq!(first.made(), Some("there was none"));
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(fs::metadata(file.parent().unwrap()).unwrap().permissions().mode() & 0o777, 0o700);
        assert_eq!(first.fingerprint().len(), 32 * 3 - 1);
        assert!((390..397).contains(&first.days_left(now)), "{}", first.days_left(now));
        let again = Certificate::kept(&file, &here, now + 300 * DAY).unwrap();
        assert_eq!((again.made(), again.fingerprint()), (None, first.fingerprint()));
        let later = Certificate::kept(&file, &here, now + 370 * DAY).unwrap();
        assert!(later.made().unwrap().contains("ends"));
        assert_ne!(later.fingerprint(), first.fingerprint());
        let moved = Certificate::kept(&file, &names("192.168.7.3 desk"), now).unwrap();
        assert!(moved.made().unwrap().contains("addresses"));
        assert_eq!(fs::read_dir(file.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn one_that_others_could_read_or_that_is_damaged_in_any_place_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("c");
        let (here, now) = (names("192.168.7.2 localhost"), SystemTime::now());
        let made = |why: &str| {
            let certificate = Certificate::kept(&file, &here, now).unwrap();
            assert!(
                certificate.made().is_some_and(|reported| reported.contains(why)),
                "{why} {certificate:?}"
            );
        };
        made("none");
        fs::set_permissions(&file, Permissions::from_mode(0o640)).unwrap();
        made("others could read");
        let whole = fs::read_to_string(&file).unwrap();
        for cut in (0..whole.len() - 1).step_by(29) {
            fs::write(&file, &whole[..cut]).unwrap();
            let certificate = Certificate::kept(&file, &here, now).unwrap();
            assert!(certificate.made().is_some(), "{cut}");
        }
        fs::write(&file, [0xff; 3000]).unwrap();
        made("damaged");
        // The key of another certificate.
        let other = fs::read_to_string(&file).unwrap();
        let key = |text: &str| text.lines().last().unwrap().to_owned();
        fs::write(&file, whole.replace(&key(&whole), &key(&other))).unwrap();
        made("does not fit its key");
    }

    #[test]
    fn a_name_that_no_certificate_can_hold_and_a_folder_that_cannot_be_written_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::now();
        let reported = Certificate::kept(&folder.path().join("c"), &names("d\u{e9}sk"), now).unwrap_err();
        assert!(reported.to_string().contains("--lan=ADDRESS"), "{reported}");
        fs::write(folder.path().join("file"), "").unwrap();
        let reported =
            Certificate::kept(&folder.path().join("file/c"), &names("localhost"), now).unwrap_err();
        assert!(reported.to_string().contains("XDG_STATE_HOME"), "{reported}");
    }
}
