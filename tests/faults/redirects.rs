//! Downloads from the bucket itself, by signed URLs, for clients that ask for them.

use std::{fs, path::PathBuf, process::Command};

use reqwest::{Client, Method, Response, StatusCode, Url, redirect};

use crate::{
    input::{profile, zip},
    service::Service,
    site::Site,
};

const VALID_S: u64 = 90;

fn header<'a>(answer: &'a Response, name: &str) -> &'a str {
    answer.headers().get(name).map(|value| value.to_str().expect("ASCII")).unwrap_or_default()
}

/// The settings of a service that signs URLs.
fn signing(site: &Site) -> PathBuf {
    let file = site.settings("signing", &site.database, &site.endpoint);
    let text = fs::read_to_string(&file).expect("UTF-8") + &format!("storage_presigned_s = {VALID_S}\n");
    fs::write(&file, text).expect("a file");
    file
}

/// A service that signs URLs, with one stack, and the paths of its stored files.
async fn with_stack(site: &Site) -> (Service, String) {
    let settings = signing(site);
    let api = site.api("api", &settings).await;
    site.put_profile(&api, &profile()).await;
    let url = format!("{}/v1/stacks?rig=rig&lens=lens&label=K%C3%A4fer", api.url);
    let sent = site.client.post(url).body(zip()).send().await.expect("an answer");
    let stack = sent.headers()["location"].to_str().expect("a path").to_owned();
    let worker = site.worker("worker", &settings, None);
    site.succeeded(&api, &stack).await;
    worker.stop().await;
    (api, stack)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_client_that_asks_gets_stored_files_from_the_bucket_with_the_same_name_and_type() {
    let site = Site::fresh().await;
    let (api, stack) = with_stack(&site).await;
    let still = Client::builder().no_proxy().redirect(redirect::Policy::none()).build().expect("a client");
    for file in ["image", "depth", "preview", "upload"] {
        let url = format!("{}{stack}/{file}", api.url);
        let by_service = still.get(&url).send().await.expect("an answer");
        assert_eq!(by_service.status(), StatusCode::OK, "{file}: without the parameter the service sends it");
        let sent = still.get(format!("{url}?redirect=true")).send().await.expect("an answer");
        assert_eq!(sent.status(), StatusCode::TEMPORARY_REDIRECT, "{file}");
        let location = header(&sent, "location").to_owned();
        assert!(location.starts_with(&site.endpoint), "{location}");
        assert!(location.contains(&format!("X-Amz-Expires={VALID_S}")), "{location}");
        assert!(location.contains("X-Amz-Signature="), "{location}");
        assert_eq!(header(&sent, "cache-control"), "no-store", "{file}");

        let by_bucket = site.client.get(format!("{url}?redirect=true")).send().await.expect("an answer");
        assert_eq!(by_bucket.status(), StatusCode::OK, "{file}");
        // each request is signed anew, with the time in seconds
        let (followed, told) = (by_bucket.url().clone(), Url::parse(&location).expect("a URL"));
        assert_eq!((followed.origin(), followed.path()), (told.origin(), told.path()), "{file}");
        for name in ["content-type", "content-disposition", "content-length", "cache-control"] {
            assert_eq!(header(&by_bucket, name), header(&by_service, name), "{file}: {name}");
        }
        let (bytes, expected) = (by_bucket.bytes().await.expect("bytes"), by_service.bytes().await.expect("bytes"));
        assert!(bytes == expected && !bytes.is_empty(), "{file}: the same bytes");

        let part = site.client.get(format!("{url}?redirect=true")).header("range", "bytes=10-19").send().await;
        let part = part.expect("an answer");
        assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT, "{file}");
        assert_eq!(part.bytes().await.expect("bytes"), expected[10..20], "{file}");
    }
    api.stop().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn the_service_answers_itself_where_a_signed_url_would_not_do() {
    let site = Site::fresh().await;
    let (api, stack) = with_stack(&site).await;
    let image = format!("{}{stack}/image", api.url);
    let still = Client::builder().no_proxy().redirect(redirect::Policy::none()).build().expect("a client");
    let tag = header(&still.get(&image).send().await.expect("an answer"), "etag").to_owned();
    let ask = async |method: Method, query: &str, headers: &[(&str, &str)]| {
        let request = still.request(method, format!("{image}{query}"));
        let request = headers.iter().fold(request, |request, (name, value)| request.header(*name, *value));
        request.send().await.expect("an answer").status().as_u16()
    };
    let asked = "?redirect=true";
    assert_eq!(ask(Method::GET, asked, &[]).await, 307);
    assert_eq!(ask(Method::GET, asked, &[("if-none-match", "\"another\"")]).await, 307);
    assert_eq!(ask(Method::HEAD, asked, &[]).await, 200);
    assert_eq!(ask(Method::GET, "?redirect=false", &[]).await, 200);
    assert_eq!(ask(Method::GET, asked, &[("accept", "image/tiff")]).await, 200, "a conversion is not in the bucket");
    assert_eq!(ask(Method::GET, asked, &[("if-match", &tag)]).await, 200);
    assert_eq!(ask(Method::GET, asked, &[("if-none-match", &tag)]).await, 304);
    assert_eq!(ask(Method::GET, asked, &[("range", "bytes=0-9"), ("if-range", &tag)]).await, 206);
    assert_eq!(ask(Method::GET, "?redirect=perhaps", &[]).await, 400);

    // a process without the setting serves the same request
    let plain = site.api("plain", &site.settings("plain", &site.database, &site.endpoint)).await;
    let answer = still.get(format!("{}{stack}/image{asked}", plain.url)).send().await.expect("an answer");
    assert_eq!(answer.status(), StatusCode::OK);
    plain.stop().await;

    let deleted = still.delete(format!("{}{stack}", api.url)).send().await.expect("an answer");
    assert_eq!(deleted.status(), StatusCode::NO_CONTENT);
    assert_eq!(ask(Method::GET, asked, &[]).await, 404, "what is deleted is not signed");
    api.stop().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn curl_follows_the_redirect_and_names_the_file() {
    let site = Site::fresh().await;
    let (api, stack) = with_stack(&site).await;
    let folder = site.data("downloads");
    fs::create_dir(&folder).expect("a folder");
    let url = format!("{}{stack}/image?redirect=true", api.url);
    let mut curl = Command::new("curl");
    curl.args(["-sS", "--fail", "--noproxy", "*", "-L", "-OJ", &url]).current_dir(&folder);
    let done = curl.output().expect("curl");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let names: Vec<_> =
        fs::read_dir(&folder).expect("a folder").map(|file| file.expect("a file").file_name()).collect();
    // curl takes the name in ASCII
    assert_eq!(names, ["K_fer.png"]);
    assert_eq!(fs::read(folder.join("K_fer.png")).expect("a file"), site.image(&api, &stack).await);
    api.stop().await;
}
