//! Verdicts with their cures, the search of stacks, and the home page.

use pinstack::contract::{Code, Fault};
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::{
    app::{TestApp, id, problem},
    pages::{HTML, checked, page},
};

async fn json_of(app: &TestApp, path: &str) -> Value {
    let answer = app.get(path).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK, "{path}");
    answer.json().await.unwrap()
}

/// Sends a stack and ends it with warnings. Returns its id.
async fn warned(app: &TestApp, options: &str, codes: &[&str]) -> String {
    let stack = id(&app.with_stack(options).await);
    app.finish_warned(&app.claim().await, codes).await;
    stack.to_string()
}

#[tokio::test]
async fn a_reversed_stack_must_not_be_used_and_is_mended_by_the_request_that_its_finding_names() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let options = "&scan=bee&pan_deg=20&tilt_deg=0";
    let waiting = app.with_stack(options).await;
    assert_eq!((&waiting["verdict"], &waiting["advice"]), (&Value::Null, &json!([])));
    app.finish_warned(&app.claim().await, &["exposure_flicker", "slices_reversed"]).await;
    let path = format!("/v1/stacks/{}", id(&waiting));
    let stack = json_of(&app, &path).await;
    assert_eq!(stack["verdict"], "do_not_use");
    let [worst, milder] = stack["advice"].as_array().unwrap().as_slice() else { panic!("two: {stack}") };
    assert_eq!((&worst["code"], &milder["code"]), (&json!("slices_reversed"), &json!("exposure_flicker")));
    assert_eq!(worst["title"], "The slices are in reverse order");
    let action = &worst["actions"][0];
    assert_eq!((&action["kind"], &action["method"]), (&json!("fuse_again"), &json!("POST")));
    assert_eq!(json_of(&app, "/v1/scans/bee").await["views"][0]["verdict"], "do_not_use");

    // on the pages as colour and word
    let shown = page(&app, &format!("/stacks/{}", id(&waiting))).await;
    let place = |text: &str| shown.find(text).unwrap_or_else(|| panic!("no {text}: {shown}"));
    assert!(place("state poor") < place("The slices are in reverse order"));
    assert!(place("The slices are in reverse order") < place("The brightness flickers"));
    assert!(place("TROUBLESHOOTING#slices_reversed") > 0 && !shown.contains("state good"));
    for path in ["/stacks", "/scans/bee"] {
        let text = page(&app, path).await;
        assert!(text.contains("Do not use it") && !text.contains("state good"), "{path}: {text}");
    }

    // the button sends this
    let sent = app.post(action["href"].as_str().unwrap()).json(&action["options"]).send().await.unwrap();
    assert_eq!(sent.status(), StatusCode::ACCEPTED);
    assert_eq!(sent.json::<Value>().await.unwrap()["options"]["order"], "reverse");
    app.finish_warned(&app.claim().await, &[]).await;
    let view = json_of(&app, "/v1/scans/bee").await["views"][0].clone();
    assert_eq!((&view["verdict"], view["replaced"].as_array().map(Vec::len)), (&json!("use"), Some(1)));
    // a calibration that is current already is no cure
    let misfit = warned(&app, "", &["profile_misfit"]).await;
    let text = page(&app, &format!("/stacks/{misfit}")).await;
    assert!(text.contains("/send?purpose=calibration") && !text.contains("Fuse again with the current"), "{text}");
    app.with_profile(2).await;
    let text = page(&app, &format!("/stacks/{misfit}")).await;
    assert!(text.contains("Fuse again with the current revision of the profile"), "{text}");
}

#[tokio::test]
async fn stacks_are_found_by_words_dates_and_verdict_with_totals() {
    let app = TestApp::start().await;
    app.with_scan("bees-2026").await;
    let beetle = warned(&app, "&label=K%C3%A4fer%20IMG4711", &["clipped"]).await;
    let wasp = warned(&app, "&label=wasp&scan=bees-2026", &[]).await;
    let broken = id(&app.with_stack("&label=wasp%20two").await).to_string();
    app.fail(&app.claim().await, Fault::new(Code::SizeMismatch, "too small")).await;
    let found = async |query: &str| -> Vec<String> {
        let list = json_of(&app, &format!("/v1/stacks?{query}")).await;
        list["items"].as_array().unwrap().iter().map(|item| item["id"].as_str().unwrap().to_owned()).collect()
    };
    let today = jiff::Timestamp::now().strftime("%Y-%m-%d").to_string();
    for (query, expected) in [
        ("q=k%C3%A4f", vec![&beetle]),
        ("q=KA%CC%88FER%204711", vec![&beetle]),
        ("q=wasp", vec![&broken, &wasp]),
        ("q=was%20bees", vec![&wasp]),
        ("q=wasp&state=failed", vec![&broken]),
        ("q=asp", vec![]),
        ("verdict=look", vec![&beetle]),
        ("verdict=use&rig=rig&lens=lens", vec![&wasp]),
        ("verdict=do_not_use", vec![]),
        ("scan=bees-2026", vec![&wasp]),
        ("since=2100-01-01", vec![]),
        ("until=2020-01-01", vec![]),
        (format!("since={today}&q=wasp").as_str(), vec![&broken, &wasp]),
        (format!("until={today}&verdict=look").as_str(), vec![&beetle]),
    ] {
        assert_eq!(found(query).await, expected.into_iter().cloned().collect::<Vec<_>>(), "{query}");
    }
    let totals = json!({ "stacks": 3, "use": 1, "look": 1, "do_not_use": 0, "failed": 1 });
    assert_eq!(json_of(&app, "/v1/stack-totals").await, totals);
    assert_eq!(json_of(&app, "/v1/stack-totals?q=wasp").await["stacks"], 2);
    problem(app.get("/v1/stacks?verdict=bad").send().await.unwrap(), 400, "invalid_request").await;
    let told = problem(app.get("/v1/stacks?since=monday").send().await.unwrap(), 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("a date such as"), "{told}");

    let text = page(&app, "/stacks?q=was&verdict=use").await;
    assert!(text.contains("2 stacks: 1 failed") && text.contains("value=\"was\""), "{text}");
    assert!(
        text.contains("href=\"/stacks?q=was&amp;verdict=look\"") && text.contains("aria-current=\"true\""),
        "{text}"
    );
    assert!(!text.contains("wasp two"), "{text}");
    // a deleted stack is not counted
    assert!(app.delete(&format!("/v1/stacks/{wasp}")).send().await.unwrap().status().is_success());
    assert_eq!(json_of(&app, "/v1/stack-totals").await["use"], 0);
}

#[tokio::test]
async fn the_home_page_shows_what_is_new_since_the_last_visit() {
    let app = TestApp::start().await;
    let old = "/?state=failed&q=bee%20fly";
    let client = crate::pages::still();
    let moved = client.get(format!("{}{old}", app.base)).header("accept", HTML).send().await.unwrap();
    assert_eq!(moved.headers()["location"], "/stacks?state=failed&q=bee%20fly");
    assert!(page(&app, "/").await.contains("Nothing runs, and nothing waits"));
    warned(&app, "&label=reversed-one", &["slices_reversed"]).await;
    app.with_stack("&label=waiting-one").await;
    let answer = app.get("/").header("accept", HTML).send().await.unwrap();
    let cookie = answer.headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap().to_owned();
    let text = checked(answer).await;
    for words in ["reversed-one", "waiting-one", "2 stacks: 1 not to be used", "are free", "rig · lens"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let (_, last) = cookie.split_once('-').unwrap();
    let ended = last.parse::<i64>().unwrap() + 1;
    // the last visit ended after that stack did
    let visit = format!("pinstack_visit=1-{ended}");
    let later = app.get("/").header("accept", HTML).header("cookie", visit);
    let text = checked(later.send().await.unwrap()).await;
    assert!(text.contains("reversed-one"), "the visit goes on: {text}");
    let part = app.get("/?part=now").send().await.unwrap().text().await.unwrap();
    assert!(part.contains("waiting-one") && !part.contains("<html"), "{part}");
}
