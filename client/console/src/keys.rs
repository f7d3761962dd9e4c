//! What opens the control: the token in the printed address, and the key that a page got for it.
//!
//! Contract: pure. A token that works once gives its page a key of its own, so that an address that somebody
//! else has seen since then opens nothing.

use foretrace_serve::guard::Token;

#[derive(Debug)]
pub(crate) struct Keys {
    token: Token,
    /// The token works once; `None`: as often as it is presented.
    once: Option<Once>,
}

#[derive(Debug, Default)]
struct Once {
    used: bool,
    key: Option<Token>,
}

/// What a token or key is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum KeyVerdict {
    Opens,
    /// It opens, this once.
    OpensOnce,
    Wrong,
    /// It was right, and has been used.
    Used,
}

impl Keys {
    pub(crate) fn new(token: Token, once: bool) -> Self {
        Self { token, once: once.then(Once::default) }
    }

    /// The token's text, for the address that is printed.
    pub(crate) fn text(&self) -> &str {
        self.token.text()
    }

    /// Judges what a page presents.
    pub(crate) fn judge(&self, presented: &str) -> KeyVerdict {
        let token = self.token.is(presented);
        match &self.once {
            None if token => KeyVerdict::Opens,
            Some(once) if token => {
                if once.used {
                    KeyVerdict::Used
                } else {
                    KeyVerdict::OpensOnce
                }
            }
            Some(Once { key: Some(key), .. }) if key.is(presented) => KeyVerdict::Opens,
            _ => KeyVerdict::Wrong,
        }
    }

    /// The token has been used: from here on only the key opens, which replaces any before it.
    pub(crate) fn use_up(&mut self, key: Token) {
        if let Some(once) = &mut self.once {
            *once = Once { used: true, key: Some(key) };
        }
    }

    /// A token that works once more; the key of a page stays until that is used.
    pub(crate) fn renew(&mut self, token: Token) {
        self.token = token;
        if let Some(once) = &mut self.once {
            once.used = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_that_works_once_gives_a_key_and_a_new_token_takes_its_place_when_it_is_used() {
        let token = || Token::random().unwrap();
        let (first, key, second, other) = (token(), token(), token(), token());
        let mut always = Keys::new(first.clone(), false);
        always.use_up(key.clone());
        assert_eq!(
            (always.judge(first.text()), always.judge(key.text())),
            (KeyVerdict::Opens, KeyVerdict::Wrong)
        );
        let mut keys = Keys::new(first.clone(), true);
        assert_eq!(
            (keys.judge(first.text()), keys.judge(key.text())),
            (KeyVerdict::OpensOnce, KeyVerdict::Wrong)
        );
        keys.use_up(key.clone());
        assert_eq!((keys.judge(first.text()), keys.judge(key.text())), (KeyVerdict::Used, KeyVerdict::Opens));
        keys.renew(second.clone());
        let judged = [&first, &key, &second].map(|token| keys.judge(token.text()));
        assert_eq!(judged, [KeyVerdict::Wrong, KeyVerdict::Opens, KeyVerdict::OpensOnce]);
        keys.use_up(other.clone());
        let judged = [&key, &second, &other].map(|token| keys.judge(token.text()));
        assert_eq!(judged, [KeyVerdict::Wrong, KeyVerdict::Used, KeyVerdict::Opens]);
    }
}
